// The functions of the step that Python calls. Arrays are contiguous and component-first.
#include "failing.hpp"
#include "guarded.hpp"
#include "transfer.hpp"

using namespace pcnclaws;
using T = NUMBER;

namespace {

State<T> state_of(T* const* fields) { return {{fields[0]}, {fields[1]}, {fields[2]}, {fields[3]}}; }
State<Rate<T>> state_of(T* const* fields, T* const* rates) {
    return {{fields[0], rates[0]}, {fields[1], rates[1]}, {fields[2], rates[2]}, {fields[3], rates[3]}};
}

}  // namespace

// state: position, velocity, affine, deformation; a fifth array before the step is the stress

KERNEL(step_forward)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* after, int threads) {
    return guarded([&] {
        const auto state = state_of(before);
        const Field<T> stress{before[4]};
        if (!in_order(*bodies)) return false;
        Step<T>(*settings, *bodies, state, stress, threads).forward(state_of(after));
        return true;
    });
}

KERNEL(step_adjoint)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* after, T* const* incoming,
 T* const* gradient, int threads) {
    return guarded([&] {
        const auto state = state_of(before);
        const Field<T> stress{before[4]};
        Step<T>(*settings, *bodies, state, stress, threads)
            .adjoint({after[1], after[2]}, state_of(incoming), state_of(gradient), {gradient[4]});
        return true;
    });
}

KERNEL(step_rates)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* before_rates, T* const* after,
 T* const* after_rates, int threads) {
    return guarded([&] {
        const auto state = state_of(before, before_rates);
        const Field<Rate<T>> stress{before[4], before_rates[4]};
        Step<Rate<T>>(*settings, *bodies, state, stress, threads).forward(state_of(after, after_rates));
        return true;
    });
}

// A step whose work on the grid is done by others, between the two: nodes are the whole grid of the settings for each scene,
// in order, four numbers a node; with rates four more, the rates.

KERNEL(to_grid)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* nodes, int threads) {
    return guarded([&] {
        const auto state = state_of(before);
        const Field<T> stress{before[4]};
        if (!in_order(*bodies)) return false;
        Step<T>(*settings, *bodies, state, stress, threads, true).to_grid(reinterpret_cast<Quad<T>*>(nodes[0]));
        return true;
    });
}

KERNEL(to_grid_rates)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* before_rates, T* const* nodes,
 int threads) {
    return guarded([&] {
        const auto state = state_of(before, before_rates);
        const Field<Rate<T>> stress{before[4], before_rates[4]};
        if (!in_order(*bodies)) return false;
        Step<Rate<T>>(*settings, *bodies, state, stress, threads, true)
            .to_grid(reinterpret_cast<Quad<Rate<T>>*>(nodes[0]));
        return true;
    });
}

KERNEL(from_grid)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* velocities, T* const* after,
 int threads) {
    return guarded([&] {
        const auto state = state_of(before);
        const Field<T> stress{nullptr};
        if (!in_order(*bodies)) return false;
        Step<T>(*settings, *bodies, state, stress, threads, true)
            .from_grid(reinterpret_cast<const Quad<T>*>(velocities[0]), state_of(after));
        return true;
    });
}

KERNEL(from_grid_rates)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* before_rates, T* const* velocities,
 T* const* after, T* const* after_rates, int threads) {
    return guarded([&] {
        const auto state = state_of(before, before_rates);
        const Field<Rate<T>> stress{nullptr, nullptr};
        if (!in_order(*bodies)) return false;
        Step<Rate<T>>(*settings, *bodies, state, stress, threads, true)
            .from_grid(reinterpret_cast<const Quad<Rate<T>>*>(velocities[0]), state_of(after, after_rates));
        return true;
    });
}

KERNEL(to_node_velocities)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* incoming, T* const* gradients,
 int threads) {
    return guarded([&] {
        const auto state = state_of(before);
        const Field<T> stress{nullptr};
        Step<T>(*settings, *bodies, state, stress, threads, true)
            .to_node_velocities(state_of(incoming), reinterpret_cast<Quad<T>*>(gradients[0]));
        return true;
    });
}

// nodes: velocities, and gradients at momentum and mass
KERNEL(gather_gradient)
(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* nodes, T* const* after,
 T* const* incoming, T* const* gradient, int threads) {
    return guarded([&] {
        const auto state = state_of(before);
        const Field<T> stress{before[4]};
        Step<T>(*settings, *bodies, state, stress, threads, true)
            .gather_gradient(reinterpret_cast<const Quad<T>*>(nodes[0]), reinterpret_cast<const Quad<T>*>(nodes[1]),
                             {after[1], after[2]}, state_of(incoming), state_of(gradient), {gradient[4]});
        return true;
    });
}

// position (3, particles), deformation (9, particles)

KERNEL(failing)
(const int64_t* count, const Corners* domain, const T* position, const T* deformation, bool* failed, int) {
    return guarded([&] {
        find_failing(*count, *domain, position, deformation, failed);
        return true;
    });
}
