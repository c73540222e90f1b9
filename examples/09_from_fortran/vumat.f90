! An exported law as a VUMAT, the user material of explicit finite element codes, in double precision and three dimensions.
!
!   gfortran -c material_point.f90 vumat.f90
!
! props and the state variables are those of umat.f90. Stresses are in axes that turn with the body.
subroutine vumat(nblock, ndir, nshr, nstatev, nfieldv, nprops, lanneal, stepTime, totalTime, dt, cmname, coordMp, &
                 charLength, props, density, strainInc, relSpinInc, tempOld, stretchOld, defgradOld, fieldOld, &
                 stressOld, stateOld, enerInternOld, enerInelasOld, tempNew, stretchNew, defgradNew, fieldNew, &
                 stressNew, stateNew, enerInternNew, enerInelasNew)
    use, intrinsic :: iso_c_binding, only: c_double
    use material_point
    implicit none
    integer :: nblock, ndir, nshr, nstatev, nfieldv, nprops, lanneal
    character(len=80) :: cmname
    real(c_double) :: stepTime, totalTime, dt
    real(c_double) :: coordMp(nblock, *), charLength(nblock), props(nprops), density(nblock), &
        strainInc(nblock, ndir + nshr), relSpinInc(nblock, nshr), tempOld(nblock), tempNew(nblock), &
        stretchOld(nblock, ndir + nshr), stretchNew(nblock, ndir + nshr), defgradOld(nblock, ndir + 2*nshr), &
        defgradNew(nblock, ndir + 2*nshr), fieldOld(nblock, *), fieldNew(nblock, *), stressOld(nblock, ndir + nshr), &
        stressNew(nblock, ndir + nshr), stateOld(nblock, nstatev), stateNew(nblock, nstatev), enerInternOld(nblock), &
        enerInternNew(nblock), enerInelasOld(nblock), enerInelasNew(nblock)
    ! 11 22 33 12 23 31 of explicit codes in the order 11 22 33 12 13 23
    integer, parameter :: order(6) = [1, 2, 3, 4, 6, 5]
    real(c_double) :: f_old(3, 3), f_new(3, 3), state(nstatev), strain(6), stretch(6), stress(6)
    integer :: k

    if (ndir /= 3 .or. nshr /= 3) then
        write (*, *) 'error: this VUMAT is for three dimensions'
        stop 1
    end if
    if (nprops < pcnclaws_property_count() .or. nstatev < pcnclaws_state_count()) then
        write (*, *) 'error: this law has', pcnclaws_property_count(), 'properties and', pcnclaws_state_count(), &
            'state variables'
        stop 1
    end if
    do k = 1, nblock
        state = stateOld(k, :)
        if (totalTime == 0.0_c_double) then
            ! before the first increment, codes ask for the stiffness of a body at rest, with strains of their own
            strain = strainInc(k, :)
            f_old = reshape([1, 0, 0, 0, 1, 0, 0, 0, 1], [3, 3])
            f_new = f_old + matrix([strain, strain(4:6)])
            stretch = strain(order) + [1, 1, 1, 0, 0, 0]
        else
            f_old = matrix(defgradOld(k, :))
            f_new = matrix(defgradNew(k, :))
            stretch = stretchNew(k, order)
        end if
        call pcnclaws_material_stress(props, f_old, f_new, dt, state, stress)
        call pcnclaws_turn_with_body(f_new, stretch, stress)
        stressNew(k, order) = stress
        stateNew(k, :) = merge(stateOld(k, :), state, totalTime == 0.0_c_double)
    end do

contains

    ! of the components 11 22 33 12 23 31 21 32 13
    pure function matrix(given) result(f)
        real(c_double), intent(in) :: given(9)
        real(c_double) :: f(3, 3)
        f(1, :) = [given(1), given(4), given(9)]
        f(2, :) = [given(7), given(2), given(5)]
        f(3, :) = [given(6), given(8), given(3)]
    end function matrix
end subroutine vumat
