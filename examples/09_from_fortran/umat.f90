! An exported law as a UMAT, the user material of implicit finite element codes: three-dimensional and plane strain.
!
!   gfortran -c material_point.f90 umat.f90
!
! PROPS are the physical parameters, STATEV the elastic deformation gradient and the internal variables
! (pcnclaws_state_count() of them). The sections of the model need NLGEOM. Stresses are Cauchy stresses, and DDSDDE is the
! tangent of the Jaumann rate of the Kirchhoff stress over J.
subroutine umat(stress, statev, ddsdde, sse, spd, scd, rpl, ddsddt, drplde, drpldt, stran, dstran, time, dtime, temp, &
                dtemp, predef, dpred, cmname, ndi, nshr, ntens, nstatv, props, nprops, coords, drot, pnewdt, celent, &
                dfgrd0, dfgrd1, noel, npt, layer, kspt, kstep, kinc)
    use, intrinsic :: iso_c_binding, only: c_double
    use material_point
    implicit none
    integer :: ndi, nshr, ntens, nstatv, nprops, noel, npt, layer, kspt, kstep, kinc
    character(len=80) :: cmname
    real(c_double) :: stress(ntens), statev(nstatv), ddsdde(ntens, ntens), ddsddt(ntens), drplde(ntens), stran(ntens), &
        dstran(ntens), time(2), predef(1), dpred(1), props(nprops), coords(3), drot(3, 3), dfgrd0(3, 3), dfgrd1(3, 3)
    real(c_double) :: sse, spd, scd, rpl, drpldt, dtime, temp, dtemp, pnewdt, celent
    real(c_double) :: all_stresses(6), whole_tangent(6, 6)

    if (nprops < pcnclaws_property_count() .or. nstatv < pcnclaws_state_count()) then
        write (*, *) 'error: this law has', pcnclaws_property_count(), 'properties and', pcnclaws_state_count(), &
            'state variables'
        stop 1
    end if
    call pcnclaws_material_point(props, dfgrd0, dfgrd1, dtime, statev, all_stresses, whole_tangent)
    stress = all_stresses(1:ntens)
    ddsdde = whole_tangent(1:ntens, 1:ntens)
    ! a state that is not finite: a smaller increment
    if (any(stress /= stress)) pnewdt = 0.25_c_double
end subroutine umat
