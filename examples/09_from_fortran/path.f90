! A material point along a path of deformation gradients, through umat and through vumat.
!
!   gfortran material_point.f90 umat.f90 vumat.f90 path.f90 material_point.o -lstdc++ -o path
!   (echo "0.01 4e5 0.25 30"; echo "1 0.01 0  0 0.99 0  0 0 1"; echo "1 0.02 0  0 0.98 0  0 0 1") | ./path
!
! Reads the time of an increment [s] and the properties, then deformation gradients, row by row, a line for each increment.
! Prints for each: the stress of umat [Pa] (11 22 33 12 13 23), its state variables, DDSDDE column by column [Pa], and the
! stress of vumat in axes that turn with the body [Pa] (11 22 33 12 23 31).
program path
    use, intrinsic :: iso_c_binding, only: c_double
    use material_point
    implicit none
    real(c_double), parameter :: identity(3, 3) = reshape([1, 0, 0, 0, 1, 0, 0, 0, 1]*1.0_c_double, [3, 3])
    real(c_double), allocatable :: properties(:), state(:), explicit_old(:, :), explicit_new(:, :)
    real(c_double) :: f_old(3, 3), f_new(3, 3), stress(6), tangent(6, 6), turning(1, 6), row(9), time_step
    integer :: increment, status

    allocate (properties(pcnclaws_property_count()), state(pcnclaws_state_count()))
    allocate (explicit_old(1, size(state)), explicit_new(1, size(state)))
    read (*, *) time_step, properties
    state = 0
    explicit_old = 0
    f_old = identity
    increment = 0
    do
        read (*, *, iostat=status) row
        if (status /= 0) exit
        increment = increment + 1
        f_new = transpose(reshape(row, [3, 3]))
        call call_umat
        call call_vumat
        write (*, '(*(es25.16e3))') stress, state, tangent, turning
        f_old = f_new
        explicit_old = explicit_new
    end do

contains

    subroutine call_umat
        character(len=80), parameter :: name = 'LAW'
        real(c_double) :: none(6), time(2), one(1), coordinates(3), turn(3, 3), scalar
        none = 0
        time = 0
        one = 0
        coordinates = 0
        turn = identity
        scalar = 1
        call umat(stress, state, tangent, scalar, scalar, scalar, scalar, none, none, scalar, none, none, time, time_step, &
                  scalar, scalar, one, one, name, 3, 3, 6, size(state), properties, size(properties), coordinates, &
                  turn, scalar, scalar, f_old, f_new, 1, 1, 1, 1, 1, increment)
    end subroutine call_umat

    subroutine call_vumat
        character(len=80), parameter :: name = 'LAW'
        real(c_double) :: none(1), strain(1, 6), spin(1, 3), old(1, 9), new(1, 9), u_old(1, 6), u_new(1, 6), time
        none = 0
        strain = 0
        spin = 0
        time = increment*time_step
        old(1, :) = components(f_old)
        new(1, :) = components(f_new)
        u_old(1, :) = stretch(f_old)
        u_new(1, :) = stretch(f_new)
        call vumat(1, 3, 3, size(state), 1, size(properties), 0, time, time, time_step, name, none, none, properties, &
                   none, strain, spin, none, u_old, old, none, turning, explicit_old, none, none, none, u_new, new, none, &
                   turning, explicit_new, none, none)
    end subroutine call_vumat

    ! 11 22 33 12 23 31 21 32 13
    pure function components(f) result(c)
        real(c_double), intent(in) :: f(3, 3)
        real(c_double) :: c(9)
        c = [f(1, 1), f(2, 2), f(3, 3), f(1, 2), f(2, 3), f(3, 1), f(2, 1), f(3, 2), f(1, 3)]
    end function components

    ! U = R^T F, with the rotation R by Newton's iteration: the mean of R and its inverse transpose.
    pure function stretch(f) result(u)
        real(c_double), intent(in) :: f(3, 3)
        real(c_double) :: u(6), r(3, 3), all_of_u(3, 3)
        integer :: iteration
        r = f
        do iteration = 1, 20
            r = (r + cofactors(r)/dot_product(r(:, 1), cross(r(:, 2), r(:, 3))))/2
        end do
        all_of_u = matmul(transpose(r), f)
        u = [all_of_u(1, 1), all_of_u(2, 2), all_of_u(3, 3), all_of_u(1, 2), all_of_u(2, 3), all_of_u(3, 1)]
    end function stretch

    pure function cofactors(a) result(c)
        real(c_double), intent(in) :: a(3, 3)
        real(c_double) :: c(3, 3)
        c(:, 1) = cross(a(:, 2), a(:, 3))
        c(:, 2) = cross(a(:, 3), a(:, 1))
        c(:, 3) = cross(a(:, 1), a(:, 2))
    end function cofactors

    pure function cross(a, b) result(c)
        real(c_double), intent(in) :: a(3), b(3)
        real(c_double) :: c(3)
        c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
    end function cross
end program path
