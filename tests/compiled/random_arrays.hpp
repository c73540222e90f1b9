// Numbers to run kernels on, in arrays of exactly their size.
#pragma once
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

template <class T> std::vector<T> random_array(size_t count, double low, double high) {
    static std::mt19937 generator(0);
    std::uniform_real_distribution<double> uniform(low, high);
    std::vector<T> out(count);
    for (auto& x : out) x = T(uniform(generator));
    return out;
}

// Deformation gradients near the identity, (9, n).
template <class T> std::vector<T> deformations(size_t n) {
    auto f = random_array<T>(9 * n, -0.05, 0.05);
    for (size_t k = 0; k < 9; k += 4)
        for (size_t p = 0; p < n; p++) f[k * n + p] += T(1);
    return f;
}

// Positions within the domain, every fifth beyond it or nowhere, (3, n).
template <class T> std::vector<T> stray_positions(size_t n) {
    auto x = random_array<T>(3 * n, 0.0, 1.0);
    for (size_t p = 0; p < n; p += 5) x[p] = T(p % 3 == 0 ? 2.0 : p % 3 == 1 ? -1e30 : NAN);
    return x;
}
