// Which particles have gone wrong: outside of the domain [0, 1]^3, turned inside out, or not finite.
#pragma once
#include <cstdint>

namespace pcnclaws {

// Looked at in every step, so that it must cost little: one pass that compilers turn into vectors. A comparison with
// NaN is false.
template <class T> void find_failing(int64_t count, const T* position, const T* deformation, bool* failed) {
    const T *x = position, *y = x + count, *z = y + count;
    const T* f[9];
    for (int k = 0; k < 9; k++) f[k] = deformation + k * count;
    for (int64_t n = 0; n < count; n++) {
        const T determinant = f[0][n] * (f[4][n] * f[8][n] - f[5][n] * f[7][n]) +
                              f[1][n] * (f[5][n] * f[6][n] - f[3][n] * f[8][n]) +
                              f[2][n] * (f[3][n] * f[7][n] - f[4][n] * f[6][n]);
        failed[n] = !((x[n] >= 0) & (x[n] <= 1) & (y[n] >= 0) & (y[n] <= 1) & (z[n] >= 0) & (z[n] <= 1) &
                      (determinant > 0));
    }
}

}  // namespace pcnclaws
