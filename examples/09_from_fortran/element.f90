! One element in uniaxial stress, driven through umat: the sides are free, and Newton's method with DDSDDE finds their stretch.
!
!   gfortran material_point.f90 umat.f90 element.f90 material_point.o -lstdc++ -o element
!   echo "4e5 0.25 30" | ./element
!
! Prints for each increment the two stretches, the axial Cauchy stress [Pa], the iterations, and what is left of the stress
! on the sides [Pa].
program element
    use, intrinsic :: iso_c_binding, only: c_double
    use material_point
    implicit none
    integer, parameter :: increments = 20, most_iterations = 20
    real(c_double), parameter :: shortest = 0.98_c_double
    real(c_double), allocatable :: properties(:), state(:), kept(:)
    real(c_double) :: f_old(3, 3), f_new(3, 3), stress(6), tangent(6, 6), side, step
    integer :: increment, iteration

    allocate (properties(pcnclaws_property_count()), state(pcnclaws_state_count()), kept(pcnclaws_state_count()))
    read (*, *) properties
    state = 0
    f_old = reshape([1, 0, 0, 0, 1, 0, 0, 0, 1], [3, 3])
    side = 1
    do increment = 1, increments
        kept = state
        do iteration = 1, most_iterations
            state = kept
            f_new = 0
            f_new(1, 1) = 1 + increment*(shortest - 1)/increments
            f_new(2, 2) = side
            f_new(3, 3) = side
            call call_umat
            if (abs(stress(2)) <= 1e-9_c_double*maxval(abs(tangent))) exit
            ! both sides move alike; DDSDDE is of the stress times J
            step = -stress(2)/(tangent(2, 2) + tangent(2, 3) - 2*stress(2))
            side = side*(1 + step)
        end do
        if (iteration > most_iterations) then
            write (*, *) 'error: no convergence'
            stop 1
        end if
        write (*, '(3es25.16, i4, es12.3)') f_new(1, 1), side, stress(1), iteration, abs(stress(2))
        f_old = f_new
    end do

contains

    subroutine call_umat
        character(len=80), parameter :: name = 'LAW'
        real(c_double) :: none(6), time(2), one(1), coordinates(3), turn(3, 3), scalar
        none = 0
        time = 0
        one = 0
        coordinates = 0
        turn = 0
        scalar = 1
        call umat(stress, state, tangent, scalar, scalar, scalar, scalar, none, none, scalar, none, none, time, scalar, &
                  scalar, scalar, one, one, name, 3, 3, 6, size(state), properties, size(properties), coordinates, &
                  turn, scalar, scalar, f_old, f_new, 1, 1, 1, 1, 1, 1)
    end subroutine call_umat
end program element
