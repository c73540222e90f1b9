// Which particles have gone wrong: outside of the domain [0, 1]^3, turned inside out, or not finite.
#pragma once
#include "standard.hpp"

namespace pcnclaws {

// A comparison with NaN is false.
template <class T> bool fails(int64_t count, const T* position, const T* deformation, int64_t n) {
    const T x = position[n], y = position[count + n], z = position[2 * count + n];
    const T* f = deformation + n;
    const T determinant = f[0] * (f[4 * count] * f[8 * count] - f[5 * count] * f[7 * count]) +
                          f[count] * (f[5 * count] * f[6 * count] - f[3 * count] * f[8 * count]) +
                          f[2 * count] * (f[3 * count] * f[7 * count] - f[4 * count] * f[6 * count]);
    return !((x >= 0) & (x <= 1) & (y >= 0) & (y <= 1) & (z >= 0) & (z <= 1) & (determinant > 0));
}

// Looked at in every step, so that it must cost little: one pass that compilers turn into vectors.
template <class T> void find_failing(int64_t count, const T* position, const T* deformation, bool* failed) {
    for (int64_t n = 0; n < count; n++) failed[n] = fails(count, position, deformation, n);
}

}  // namespace pcnclaws
