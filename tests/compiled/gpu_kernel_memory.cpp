// Runs the kernels of a law for GPUs, thread after thread on the CPU, on arrays of exactly their size, for a sanitizer to
// find what reads or writes beyond them. NUMBER, UNITS_0 to UNITS_3 and STAGED as gpu_law.cu says.
#include <cstdio>
#include <vector>

#include "gpu_law.cu"
#include "random_arrays.hpp"

int main() {
    const int64_t n = 37, stride = 64;
    const auto f = deformations<T>(n);
    const auto parameters = random_array<T>(PARAMETER_ROWS * n, 0.5, 1.5), incoming = random_array<T>(9 * n, -1.0, 1.0);
    const int sizes[LAYERS + 1] = {UNITS_0, UNITS_1, UNITS_2, UNITS_3};
    std::vector<std::vector<T>> arrays;
    Weights<T> weights{};
    int units = 0;
    for (int l = 0; l < LAYERS; l++) {
        arrays.push_back(random_array<T>(size_t(sizes[l]) * sizes[l + 1], -0.3, 0.3));
        arrays.push_back(random_array<T>(size_t(sizes[l + 1]), -0.3, 0.3));
        units += sizes[l + 1];
    }
    for (int l = 0; l < LAYERS; l++) {
        weights.w[l] = arrays[2 * l].data();
        weights.b[l] = arrays[2 * l + 1].data();
    }
    std::vector<T> result(9 * n), gradient(9 * n), of_parameters(PARAMETER_ROWS * n);
    std::vector<T> inputs((UNITS_0 + UNITS_1 + UNITS_2 + 1) * stride), gradients(units * stride);
    const NetworkMemory<T> memory{inputs.data(), gradients.data(), stride};
    for (thread = 0; thread < stride + 5; thread++) {
        law_forward(n, f.data(), parameters.data(), nullptr, weights, {result.data(), nullptr});
        law_adjoint(n, f.data(), parameters.data(), nullptr, weights, {incoming.data(), nullptr},
                    {gradient.data(), nullptr}, of_parameters.data(), memory);
    }
    std::puts("done");
}
