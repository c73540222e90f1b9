// Which particles have gone wrong: outside of the domain, turned inside out, or not finite.
#pragma once
#include "standard.hpp"

namespace pcnclaws {

// The lower and the upper corner of the domain.
struct Corners {
    double low[3], high[3];
};

// A comparison with NaN is false.
template <class T> bool fails(int64_t count, const Corners& in, const T* position, const T* deformation,
                             int64_t n) {
    const T x = position[n], y = position[count + n], z = position[2 * count + n];
    const T* f = deformation + n;
    const T determinant = f[0] * (f[4 * count] * f[8 * count] - f[5 * count] * f[7 * count]) +
                          f[count] * (f[5 * count] * f[6 * count] - f[3 * count] * f[8 * count]) +
                          f[2 * count] * (f[3 * count] * f[7 * count] - f[4 * count] * f[6 * count]);
    return !((x >= T(in.low[0])) & (x <= T(in.high[0])) & (y >= T(in.low[1])) & (y <= T(in.high[1])) &
             (z >= T(in.low[2])) & (z <= T(in.high[2])) & (determinant > 0));
}

// Looked at in every step, so that it must cost little: one pass that compilers turn into vectors.
template <class T>
void find_failing(int64_t count, const Corners& domain, const T* position, const T* deformation, bool* failed) {
    const Corners in = domain;
    for (int64_t n = 0; n < count; n++) failed[n] = fails(count, in, position, deformation, n);
}

}  // namespace pcnclaws
