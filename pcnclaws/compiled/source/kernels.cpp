// The functions that Python calls: plain C. Arrays are contiguous and component-first.
//
// Compiled once for each precision: NUMBER is its type, PRECISION the end of the names of its functions.
#include <new>

#include "failing.hpp"
#include "isotropic.hpp"
#include "transfer.hpp"

using namespace pcnclaws;
using T = NUMBER;

namespace {

// What a kernel returns; nothing may be thrown through C.
enum Status { DONE, REFUSED, OUT_OF_MEMORY };

template <class Work> int guarded(Work work) {
    try {
        return work() ? DONE : REFUSED;
    } catch (const std::bad_alloc&) {
        return OUT_OF_MEMORY;
    }
}

// Do the rows of parameters and the network fit the law?
template <class Law> bool fits(const LawInput<T>& in) {
    if (in.rows < Law::PARAMETERS || in.rows > MOST_ROWS) return false;
    if (Law::FEATURES == 0) return in.rows == Law::PARAMETERS && !in.weights;
    return in.weights && in.weights->sizes[0] == Law::FEATURES + in.rows - Law::PARAMETERS &&
           in.weights->sizes[LAYERS] == Law::OUTPUTS;
}

// Runs work(law) with the law of a number, in the order of LAWS in pcnclaws/compiled/isotropic_laws.py.
template <class Work> int with_law(int number, const LawInput<T>& in, Work work) {
    const auto run = [&](auto law) {
        if (!fits<decltype(law)>(in)) return false;
        work(law);
        return true;
    };
    return guarded([&] {
        switch (number) {
            case 0:
                return run(FixedCorotated{});
            case 1:
                return run(StVKHencky{});
            case 2:
                return run(DruckerPrager{});
            case 3:
                return run(VonMises{});
            case 4:
                return run(ElasticNet{});
            case 5:
                return run(PlasticNet{});
            case 6:
                return run(NeoHookean{});
            case 7:
                return run(Tresca{});
            case 8:
                return run(NoPriorElasticNet{});
            case 9:
                return run(FreeFlowPlasticNet{});
        }
        return false;
    });
}

State<T> state_of(T* const* fields) { return {{fields[0]}, {fields[1]}, {fields[2]}, {fields[3]}}; }
State<Rate<T>> state_of(T* const* fields, T* const* rates) {
    return {{fields[0], rates[0]}, {fields[1], rates[1]}, {fields[2], rates[2]}, {fields[3], rates[3]}};
}

}  // namespace

#define JOINED(name, precision) name##_##precision
#define EXPANDED(name, precision) JOINED(name, precision)
#define KERNEL(name) extern "C" __attribute__((visibility("default"))) int EXPANDED(name, PRECISION)

KERNEL(law_forward)(int law, const LawInput<T>* in, T* result, int threads) {
    return with_law(law, *in, [&](auto which) { law_forward<T, decltype(which)>(*in, result, threads); });
}

KERNEL(law_adjoint)
(int law, const LawInput<T>* in, const T* incoming, T* gradient, T* parameter_gradient, T* const* weights,
 int threads) {
    return with_law(law, *in, [&](auto which) {
        law_adjoint<T, decltype(which)>(*in, incoming, gradient, parameter_gradient, weights, threads);
    });
}

KERNEL(law_rates)
(int law, const LawInput<T>* in, const T* deformation_rate, const T* parameter_rate, T* result, T* result_rate,
 int threads) {
    return with_law(law, *in, [&](auto which) {
        law_rates<T, decltype(which)>(*in, deformation_rate, parameter_rate, result, result_rate, threads);
    });
}

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
