// The functions that Python calls: plain C. Arrays are contiguous and component-first.
#include "isotropic.hpp"
#include "transfer.hpp"

using namespace pcnclaws;

namespace {

// In the order of LAWS in pcnclaws/compiled/laws.py.
template <class T, template <class, class> class Visit, class... Arguments>
int choose(int law, Arguments... arguments) {
    switch (law) {
        case 0:
            Visit<T, FixedCorotated>::run(arguments...);
            return 0;
        case 1:
            Visit<T, StVKHencky>::run(arguments...);
            return 0;
        case 2:
            Visit<T, DruckerPrager>::run(arguments...);
            return 0;
        case 3:
            Visit<T, VonMises>::run(arguments...);
            return 0;
        case 4:
            Visit<T, ElasticNet>::run(arguments...);
            return 0;
        case 5:
            Visit<T, PlasticNet>::run(arguments...);
            return 0;
    }
    return 1;
}

template <class T, class Law> struct Forward {
    static void run(const LawInput<T>* in, T* result, int threads) { law_forward<T, Law>(*in, result, threads); }
};
template <class T, class Law> struct Adjoint {
    static void run(const LawInput<T>* in, const T* incoming, T* gradient, T* parameter_gradient,
                    T* const* weight_gradients, int threads) {
        law_adjoint<T, Law>(*in, incoming, gradient, parameter_gradient, weight_gradients, threads);
    }
};
template <class T, class Law> struct Rates {
    static void run(const LawInput<T>* in, const T* deformation_rate, const T* parameter_rate, T* result, int threads) {
        law_rates<T, Law>(*in, deformation_rate, parameter_rate, result, threads);
    }
};

template <class T> State<T> state_of(T* const* fields) { return {{fields[0]}, {fields[1]}, {fields[2]}, {fields[3]}}; }
template <class T> State<Rate<T>> state_of(T* const* fields, T* const* rates) {
    return {{fields[0], rates[0]}, {fields[1], rates[1]}, {fields[2], rates[2]}, {fields[3], rates[3]}};
}

}  // namespace

// Compiled once for each precision: NUMBER is its type, PRECISION the end of the names of its functions.
#define JOINED(name, precision) name##_##precision
#define EXPANDED(name, precision) JOINED(name, precision)
#define KERNEL(name) extern "C" int EXPANDED(name, PRECISION)
using T = NUMBER;

KERNEL(law_forward)(int law, const LawInput<T>* in, T* result, int threads) {
    return choose<T, Forward>(law, in, result, threads);
}

KERNEL(law_adjoint)(int law, const LawInput<T>* in, const T* incoming, T* gradient, T* parameter_gradient,
                    T* const* weights, int threads) {
    return choose<T, Adjoint>(law, in, incoming, gradient, parameter_gradient, weights, threads);
}

KERNEL(law_rates)(int law, const LawInput<T>* in, const T* deformation_rate, const T* parameter_rate, T* result,
                  int threads) {
    return choose<T, Rates>(law, in, deformation_rate, parameter_rate, result, threads);
}

// state: position, velocity, affine, deformation; a fifth array before the step is the stress

KERNEL(step_forward)(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* after,
                     int threads) {
    const auto state = state_of(before);
    const Field<T> stress{before[4]};
    Step<T>(*settings, *bodies, state, stress, threads).forward(state_of(after));
    return 0;
}

KERNEL(step_adjoint)(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* after,
                     T* const* incoming, T* const* gradient, int threads) {
    const auto state = state_of(before);
    const Field<T> stress{before[4]};
    Step<T>(*settings, *bodies, state, stress, threads)
        .adjoint({after[1], after[2]}, state_of(incoming), state_of(gradient), {gradient[4]});
    return 0;
}

KERNEL(step_rates)(const Settings* settings, const Bodies<T>* bodies, T* const* before, T* const* before_rates,
                   T* const* after, T* const* after_rates, int threads) {
    const auto state = state_of(before, before_rates);
    const Field<Rate<T>> stress{before[4], before_rates[4]};
    Step<Rate<T>>(*settings, *bodies, state, stress, threads).forward(state_of(after, after_rates));
    return 0;
}
