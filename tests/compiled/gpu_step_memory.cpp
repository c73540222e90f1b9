// Runs the kernels of a step for GPUs, thread after thread on the CPU, on arrays of exactly their size, for a sanitizer to
// find what reads or writes beyond them: with particles beside the walls, beyond them and nowhere. NUMBER as gpu_step.cu
// says.
#include <cstdio>
#include <memory>
#include <vector>

#include "gpu_step.cu"
#include "random_arrays.hpp"

static Fields fields(std::vector<std::vector<T>>& of) {
    return {of[0].data(), of[1].data(), of[2].data(), of[3].data(), of[4].data()};
}

int main() {
    const int64_t n = 41, scenes = 3, node_count = scenes * 13 * 13 * 13;
    std::vector<unsigned char> walls;
    for (int axis = 0; axis < 3; axis++)
        for (unsigned char wall : {1, 1, 1, 1, 0, 0, 0, 0, 0, 2, 2, 2, 2}) walls.push_back(wall);
    std::vector<int64_t> scene(n);
    for (int64_t p = 0; p < n; p++) scene[p] = p < n / 2 ? 0 : 2;
    const auto mass = random_array<T>(n, 0.5, 1.5), volume = random_array<T>(n, 1e-4, 2e-4);
    const auto gravity = random_array<T>(3 * scenes, -9.0, 9.0);
    const Settings settings{1e-4, {0, 0, 0}, 10, {{-1, -1, -1}, {11, 11, 11}}, SEPARATE, 0, walls.data()};
    const Bodies<T> bodies{n, scenes, scene.data(), mass.data(), volume.data(), gravity.data()};
    std::vector<std::vector<T>> before = {stray_positions<T>(n), random_array<T>(3 * n, -1.0, 1.0),
                                          random_array<T>(9 * n, -1.0, 1.0), deformations<T>(n),
                                          random_array<T>(9 * n, -9.0, 9.0)};
    auto after = before, incoming = before, gradient = before;
    std::vector<Quad<T>> momentum(node_count), moved(node_count), node_gradients(node_count);
    const std::unique_ptr<bool[]> failed(new bool[n]);
    const auto each = [](int64_t count, auto kernel) {
        for (thread = 0; thread < count + 3; thread++) kernel();
    };
    each(n, [&] { scatter_state(settings, bodies, fields(before), momentum.data()); });
    each(node_count, [&] { move_nodes(settings, bodies, momentum.data(), moved.data()); });
    each(n, [&] { gather_state(settings, bodies, fields(before), moved.data(), fields(after)); });
    each(n, [&] { scatter_gradient(settings, bodies, fields(before), fields(incoming), node_gradients.data()); });
    each(node_count, [&] { adjoint_nodes(settings, bodies, momentum.data(), node_gradients.data()); });
    // affine XPIC
    std::vector<Quad<T>> term(node_count), change(node_count), next(node_count);
    each(node_count, [&] { begin_terms(settings, bodies, momentum.data(), term.data()); });
    each(n, [&] { return_term(settings, bodies, fields(before), term.data(), LAST_TERM, change.data()); });
    each(node_count, [&] { add_term(settings, bodies, momentum.data(), term.data(), change.data(), next.data()); });
    each(node_count, [&] {
        find_term_gradient(settings, bodies, momentum.data(), node_gradients.data(), node_gradients.data(),
                           change.data(), term.data(), next.data());
    });
    const Terms<T> terms{1, {term.data()}, {node_gradients.data()}};
    each(n, [&] {
        gather_gradient(settings, bodies, fields(before), {after[1].data(), after[2].data()}, fields(incoming),
                        moved.data(), next.data(), fields(gradient), terms);
    });
    each(n, [&] { find_failing(n, Corners{{0, 0, 0}, {1, 1, 1}}, before[0].data(), before[3].data(), failed.get()); });
    std::puts("done");
}
