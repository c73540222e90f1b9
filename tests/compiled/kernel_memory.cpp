// Runs the kernels of the step on arrays of exactly their size, for a sanitizer to find what reads or writes beyond them. NUMBER is the
// type of the state.
#include <cstdio>
#include <memory>
#include <vector>

#include "failing.hpp"
#include "random_arrays.hpp"
#include "transfer.hpp"

using namespace pcnclaws;
using T = NUMBER;

// Some scenes, one of them empty, with particles beside the walls, beyond them and nowhere.
static void run_step(size_t n, bool window, int64_t order) {
    const int64_t scenes = 3;
    std::vector<unsigned char> walls;
    for (int axis = 0; axis < 3; axis++)
        for (unsigned char wall : {1, 1, 1, 1, 0, 0, 0, 0, 0, 2, 2, 2, 2}) walls.push_back(wall);
    std::vector<int64_t> scene(n);
    for (size_t p = 0; p < n; p++) scene[p] = p < n / 2 ? 0 : 2;
    const auto mass = random_array<T>(n, 0.5, 1.5), volume = random_array<T>(n, 1e-4, 2e-4);
    const auto gravity = random_array<T>(3 * scenes, -9.0, 9.0);
    const Box grid{{-1, -1, -1}, {11, 11, 11}};
    const Settings settings{1e-4, {0, 0, 0}, 10, grid, SEPARATE, window, walls.data(), order};
    const Bodies<T> bodies{int64_t(n), scenes, scene.data(), mass.data(), volume.data(), gravity.data()};
    std::vector<std::vector<T>> before = {stray_positions<T>(n), random_array<T>(3 * n, -1.0, 1.0),
                                          random_array<T>(9 * n, -1.0, 1.0), deformations<T>(n),
                                          random_array<T>(9 * n, -9.0, 9.0)};
    auto after = before, gradient = before, rates = before, after_rates = before;
    const State<T> state{{before[0].data()}, {before[1].data()}, {before[2].data()}, {before[3].data()}};
    const auto fields = [](std::vector<std::vector<T>>& of) {
        return State<T>{{of[0].data()}, {of[1].data()}, {of[2].data()}, {of[3].data()}};
    };
    const Field<T> stress{before[4].data()};
    Step<T>(settings, bodies, state, stress, 2).forward(fields(after));
    Step<T>(settings, bodies, state, stress, 2)
        .adjoint({after[1].data(), after[2].data()}, fields(rates), fields(gradient), {gradient[4].data()});
    const auto with_rates = [](std::vector<std::vector<T>>& of, std::vector<std::vector<T>>& rate) {
        return State<Rate<T>>{{of[0].data(), rate[0].data()},
                              {of[1].data(), rate[1].data()},
                              {of[2].data(), rate[2].data()},
                              {of[3].data(), rate[3].data()}};
    };
    const State<Rate<T>> moving = with_rates(before, rates);
    const Field<Rate<T>> moving_stress{before[4].data(), rates[4].data()};
    Step<Rate<T>>(settings, bodies, moving, moving_stress, 2).forward(with_rates(after, after_rates));
    // the grid apart from the particles, for all scenes of the same nodes
    std::vector<Quad<T>> nodes(scenes * grid.size());
    std::vector<Quad<Rate<T>>> moving_nodes(nodes.size());
    Step<T>(settings, bodies, state, stress, 2, true).to_grid(nodes.data());
    Step<T>(settings, bodies, state, stress, 2, true).from_grid(nodes.data(), fields(after));
    Step<T>(settings, bodies, state, stress, 2, true).to_node_velocities(fields(rates), nodes.data());
    Step<T>(settings, bodies, state, stress, 2, true)
        .gather_gradient(nodes.data(), nodes.data(), {after[1].data(), after[2].data()}, fields(rates),
                         fields(gradient), {gradient[4].data()});
    Step<Rate<T>>(settings, bodies, moving, moving_stress, 2, true).to_grid(moving_nodes.data());
    Step<Rate<T>>(settings, bodies, moving, moving_stress, 2, true)
        .from_grid(moving_nodes.data(), with_rates(after, after_rates));
    const std::unique_ptr<bool[]> failed(new bool[n]);
    find_failing(int64_t(n), Corners{{0, 0, 0}, {1, 1, 1}}, before[0].data(), before[3].data(), failed.get());
}

int main() {
    for (size_t n : {2, 37, 3000})
        for (bool window : {false, true})
            for (int64_t order : {1, 2, 4}) run_step(n, window, order);
    std::puts("done");
}
