// For programs in C and Fortran: in one source file of a program, define PCNCLAWS_C_INTERFACE before including this header.
// Matrices are row by row; `parameters` are those of struct Parameters in their order.
#ifdef PCNCLAWS_C_INTERFACE
extern "C" {
int pcnclaws_parameter_count() { return NAMESPACE::PARAMETER_COUNT; }
int pcnclaws_internal_variable_count() { return NAMESPACE::INTERNAL_VARIABLES; }
void pcnclaws_internal_start(double* internal) {
    std::copy(NAMESPACE::INTERNAL_START, NAMESPACE::INTERNAL_START + NAMESPACE::INTERNAL_VARIABLES, internal);
}
void pcnclaws_update(const double* parameters, const double* trial, const double* internal, double time_step, double* f,
                     double* internal_after, double* tau, double* tangent) {
    NAMESPACE::update(NAMESPACE::parameters_of(parameters), trial, internal, time_step, f, internal_after, tau, tangent);
}
}
#endif
