// A material point for finite element codes, between an exported law and Fortran (umat.f90, vumat.f90).
//
//   python -m pcnclaws.export law=sand output=sand.hpp
//   g++ -std=c++17 -O2 -c -DLAW_HEADER='"sand.hpp"' -DLAW=pcnclaws_sand -I. material_point.cpp
//
// properties  the physical parameters in the order of LAW::Parameters
// state       elastic deformation gradient, row by row, then the internal variables; all zero: a body at rest
// Matrices of Fortran are column by column; stresses are Cauchy stresses [Pa] in the order 11 22 33 12 13 23, and shear
// strains are engineering strains.
#include <algorithm>
#include <cmath>

#include LAW_HEADER

namespace {

constexpr int ROW[] = {0, 1, 2, 0, 0, 1}, COLUMN[] = {0, 1, 2, 1, 2, 2};

struct Matrix {
    double at[9] = {};
    double& operator()(int i, int j) { return at[3 * i + j]; }
    double operator()(int i, int j) const { return at[3 * i + j]; }
};

Matrix product(const Matrix& a, const Matrix& b) {
    Matrix c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++) c(i, j) += a(i, k) * b(k, j);
    return c;
}

double determinant(const Matrix& a) {
    return a(0, 0) * (a(1, 1) * a(2, 2) - a(1, 2) * a(2, 1)) + a(0, 1) * (a(1, 2) * a(2, 0) - a(1, 0) * a(2, 2)) +
           a(0, 2) * (a(1, 0) * a(2, 1) - a(1, 1) * a(2, 0));
}

Matrix inverse(const Matrix& a) {
    Matrix c;
    const double scale = 1.0 / determinant(a);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = (j + 1) % 3, l = (j + 2) % 3, m = (i + 1) % 3, n = (i + 2) % 3;
            c(i, j) = scale * (a(k, m) * a(l, n) - a(k, n) * a(l, m));
        }
    return c;
}

Matrix from_fortran(const double* columns) {
    Matrix a;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) a(i, j) = columns[3 * j + i];
    return a;
}

// d tau = (d tau / d trial) : (D trial) of a strain increment D, over J: the tangent of the Jaumann rate of tau.
void jaumann_tangent(const Matrix& trial, const double* of_trial, double volume, double* tangent) {
    for (int column = 0; column < 6; column++) {
        const int k = ROW[column], l = COLUMN[column];
        Matrix strain;
        strain(k, l) += 0.5;
        strain(l, k) += 0.5;
        const Matrix change = product(strain, trial);
        for (int row = 0; row < 6; row++) {
            double sum = 0.0;
            for (int j = 0; j < 9; j++) sum += of_trial[9 * (3 * ROW[row] + COLUMN[row]) + j] * change.at[j];
            tangent[6 * column + row] = sum / volume;
        }
    }
}

}  // namespace

extern "C" {

int pcnclaws_property_count() { return LAW::PARAMETER_COUNT; }
int pcnclaws_state_count() { return 9 + LAW::INTERNAL_VARIABLES; }

// One increment. f_old, f_new: deformation gradients before and after it; tangent, 6 x 6: null where it is not wanted.
void pcnclaws_material_point(const double* properties, const double* f_old, const double* f_new, double time_step,
                             double* state, double* stress, double* tangent) {
    if (std::all_of(state, state + 9, [](double x) { return x == 0.0; })) {
        for (int k = 0; k < 3; k++) state[4 * k] = 1.0;
        std::copy(LAW::INTERNAL_START, LAW::INTERNAL_START + LAW::INTERNAL_VARIABLES, state + 9);
    }
    const Matrix now = from_fortran(f_new), increment = product(now, inverse(from_fortran(f_old)));
    Matrix elastic;
    std::copy(state, state + 9, elastic.at);
    const Matrix trial = product(increment, elastic);
    double tau[9], of_trial[81];
    LAW::update(LAW::parameters_of(properties), trial.at, state + 9, time_step, state, state + 9, tau,
                tangent ? of_trial : nullptr);
    const double volume = determinant(now);
    for (int k = 0; k < 6; k++) stress[k] = tau[3 * ROW[k] + COLUMN[k]] / volume;
    if (tangent) jaumann_tangent(trial, of_trial, volume, tangent);
}

// The same without a tangent, which takes a tenth of the time.
void pcnclaws_material_stress(const double* properties, const double* f_old, const double* f_new, double time_step,
                              double* state, double* stress) {
    pcnclaws_material_point(properties, f_old, f_new, time_step, state, stress, nullptr);
}

// The stress in axes that turn with the body, R^T stress R with R = F U^-1. stretch: U in the order of the stress.
void pcnclaws_turn_with_body(const double* f_new, const double* stretch, double* stress) {
    Matrix u, cauchy;
    for (int k = 0; k < 6; k++) {
        u(ROW[k], COLUMN[k]) = u(COLUMN[k], ROW[k]) = stretch[k];
        cauchy(ROW[k], COLUMN[k]) = cauchy(COLUMN[k], ROW[k]) = stress[k];
    }
    const Matrix turn = product(from_fortran(f_new), inverse(u)), half = product(cauchy, turn);
    for (int k = 0; k < 6; k++) {
        stress[k] = 0.0;
        for (int j = 0; j < 3; j++) stress[k] += turn(j, ROW[k]) * half(j, COLUMN[k]);
    }
}
}
