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

// position (3, particles), deformation (9, particles)

KERNEL(failing)(const int64_t* count, const T* position, const T* deformation, bool* failed, int) {
    return guarded([&] {
        find_failing(*count, position, deformation, failed);
        return true;
    });
}
