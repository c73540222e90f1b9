// What programs call.
#pragma once

namespace pcnclaws {

// Matrices are row by row; a tangent has 9 x 9 numbers, [9 i + j] = d result_i / d F_j, and is left out where it is null.
// `internal` are the internal variables in the order of INTERNAL_NAMES, null where there are none. Where det F <= 0 results
// are NaN. Nothing is kept between calls: threads need no locks.

// Elastic Kirchhoff stress tau = P F^T [Pa] of the elastic deformation gradient F [-].
inline void stress(const Parameters& p, const double f[9], const double* internal, double tau[9],
                   double* tangent = nullptr) {
    elastic::LawPoint law(p, f, internal, 0.0);
    if (!tangent) return law.answer(tau, nullptr);
    const double constant[elastic::INTERNAL + 1] = {};
    law.linearise();
    for (int j = 0; j < 9; j++) {
        double direction[9] = {}, rate[9];
        direction[j] = 1.0;
        law.along(direction, constant, tau, nullptr, rate, nullptr);
        for (int i = 0; i < 9; i++) tangent[9 * i + j] = rate[i];
    }
}

// Elastic deformation gradient F [-] and internal variables after plastic flow, from those of the trial state.
// time_step  [s], read where flow takes time
inline void return_map(const Parameters& p, const double trial[9], const double* internal, double time_step,
                       double f[9], double* internal_after, double* tangent = nullptr) {
    plastic::LawPoint law(p, trial, internal, time_step);
    double after[plastic::INTERNAL + 1];
    if (tangent) {
        const double constant[plastic::INTERNAL + 1] = {};
        double after_rate[plastic::INTERNAL + 1];
        law.linearise();
        for (int j = 0; j < 9; j++) {
            double direction[9] = {}, rate[9];
            direction[j] = 1.0;
            law.along(direction, constant, f, after, rate, after_rate);
            for (int i = 0; i < 9; i++) tangent[9 * i + j] = rate[i];
        }
    } else {
        law.answer(f, after);
    }
    if (INTERNAL_VARIABLES && internal_after != internal)
        std::copy(internal, internal + INTERNAL_VARIABLES, internal_after);
    for (int k = 0; k < plastic::INTERNAL; k++) internal_after[plastic::VARIABLES[k]] = after[k];
}

// Both after each other. tangent: consistent with the return map, d tau_i / d trial_j, through F and the internal variables.
inline void update(const Parameters& p, const double trial[9], const double* internal, double time_step, double f[9],
                   double* internal_after, double tau[9], double* tangent = nullptr) {
    double before[INTERNAL_VARIABLES + 1] = {}, after[INTERNAL_VARIABLES + 1] = {};
    if (INTERNAL_VARIABLES) std::copy(internal, internal + INTERNAL_VARIABLES, before);
    return_map(p, trial, before, time_step, f, after);
    stress(p, f, after, tau);
    if (INTERNAL_VARIABLES) std::copy(after, after + INTERNAL_VARIABLES, internal_after);
    if (!tangent) return;
    plastic::LawPoint flow(p, trial, before, time_step);
    elastic::LawPoint elasticity(p, f, after, time_step);
    flow.linearise();
    elasticity.linearise();
    const double constant[plastic::INTERNAL + 1] = {};
    for (int j = 0; j < 9; j++) {
        double direction[9] = {}, f_rate[9], rate[9], value[9], own[plastic::INTERNAL + 1], own_rate[plastic::INTERNAL + 1];
        double all_rates[INTERNAL_VARIABLES + 1] = {}, internal_rate[elastic::INTERNAL + 1] = {};
        direction[j] = 1.0;
        flow.along(direction, constant, value, own, f_rate, own_rate);
        for (int k = 0; k < plastic::INTERNAL; k++) all_rates[plastic::VARIABLES[k]] = own_rate[k];
        for (int k = 0; k < elastic::INTERNAL; k++) internal_rate[k] = all_rates[elastic::VARIABLES[k]];
        elasticity.along(f_rate, internal_rate, value, nullptr, rate, nullptr);
        for (int i = 0; i < 9; i++) tangent[9 * i + j] = rate[i];
    }
}

}  // namespace pcnclaws
