! The functions of material_point.cpp, as Fortran calls them.
module material_point
    use, intrinsic :: iso_c_binding, only: c_double, c_int
    implicit none

    interface
        integer(c_int) function pcnclaws_property_count() bind(C)
            import :: c_int
        end function

        integer(c_int) function pcnclaws_state_count() bind(C)
            import :: c_int
        end function

        subroutine pcnclaws_material_point(properties, f_old, f_new, time_step, state, stress, tangent) bind(C)
            import :: c_double
            real(c_double), intent(in) :: properties(*), f_old(3, 3), f_new(3, 3)
            real(c_double), value :: time_step
            real(c_double), intent(inout) :: state(*)
            real(c_double), intent(out) :: stress(6), tangent(6, 6)
        end subroutine

        subroutine pcnclaws_material_stress(properties, f_old, f_new, time_step, state, stress) bind(C)
            import :: c_double
            real(c_double), intent(in) :: properties(*), f_old(3, 3), f_new(3, 3)
            real(c_double), value :: time_step
            real(c_double), intent(inout) :: state(*)
            real(c_double), intent(out) :: stress(6)
        end subroutine

        subroutine pcnclaws_turn_with_body(f_new, stretch, stress) bind(C)
            import :: c_double
            real(c_double), intent(in) :: f_new(3, 3), stretch(6)
            real(c_double), intent(inout) :: stress(6)
        end subroutine
    end interface
end module material_point
