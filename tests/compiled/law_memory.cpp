// Runs the kernels of a law, law.hpp, on arrays of exactly their size, for a sanitizer to find what reads or writes beyond
// them. NUMBER is the type of the state.
#include <cstdio>
#include <vector>

#include "isotropic.hpp"
#include "random_arrays.hpp"

using namespace pcnclaws;
using T = NUMBER;
constexpr bool NETWORK = Law::FEATURES > 0;

static void run_law(size_t n, int width, int threads) {
    const int rows = PARAMETER_ROWS;
    const auto f = deformations<T>(n), incoming = random_array<T>(9 * n, -1.0, 1.0);
    const auto parameters = random_array<T>(rows * n, 0.5, 1.5), rates = random_array<T>(rows * n, -1.0, 1.0);
    const auto internal = random_array<T>(INTERNAL * n, 0.0, 0.1), of_internal = random_array<T>(INTERNAL * n, -1.0, 1.0);
    std::vector<std::vector<T>> arrays, gradients;
    Weights<T> weights{};
    for (int l = 0; l <= LAYERS; l++)
        weights.sizes[l] = l == 0 ? Law::FEATURES + rows - Law::PARAMETERS : l == LAYERS ? Law::OUTPUTS : width;
    for (int l = 0; l < LAYERS; l++)
        arrays.push_back(random_array<T>(size_t(weights.sizes[l]) * weights.sizes[l + 1], -0.3, 0.3));
    for (int l = 0; l < LAYERS; l++) arrays.push_back(random_array<T>(size_t(weights.sizes[l + 1]), -0.3, 0.3));
    gradients = arrays;
    std::vector<T*> wanted;
    for (auto& gradient : gradients) wanted.push_back(gradient.data());
    for (int l = 0; l < LAYERS; l++) {
        weights.w[l] = arrays[l].data();
        weights.b[l] = arrays[LAYERS + l].data();
    }
    const LawInput<T> in{int64_t(n), f.data(), parameters.data(), rows, NETWORK ? &weights : nullptr, internal.data()};
    std::vector<T> result(9 * n), gradient(9 * n), of_parameters(rows * n), after(INTERNAL * n), moved(INTERNAL * n);
    law_forward<T, Law>(in, {result.data(), after.data()}, threads);
    law_adjoint<T, Law>(in, {incoming.data(), of_internal.data()}, {gradient.data(), moved.data()}, of_parameters.data(),
                        NETWORK ? wanted.data() : nullptr, threads);
    law_rates<T, Law>(in, {incoming.data(), of_internal.data()}, rates.data(), {result.data(), after.data()},
                      {gradient.data(), moved.data()}, threads);
}

int main() {
    for (size_t n : {1, 33, 1030})
        for (int threads : {1, 2})
            for (int width : {1, 7, 40})
                if (NETWORK || width == 1) run_law(n, width, threads);
    std::puts("done");
}
