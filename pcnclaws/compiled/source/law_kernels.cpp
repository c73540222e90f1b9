// The functions of one law, law.hpp, that Python calls. Arrays are contiguous and component-first.
#include "guarded.hpp"
#include "isotropic.hpp"

using namespace pcnclaws;
using T = NUMBER;

namespace {

// Do the rows of parameters and the network fit the law?
bool fits(const LawInput<T>& in) {
    if (in.rows != PARAMETER_ROWS) return false;
    if (Law::FEATURES == 0) return !in.weights;
    return in.weights && in.weights->sizes[0] == Law::FEATURES + PARAMETER_ROWS - Law::PARAMETERS &&
           in.weights->sizes[LAYERS] == Law::OUTPUTS;
}

}  // namespace

KERNEL(law_forward)(const LawInput<T>* in, const LawFields<T>* result, int threads) {
    return guarded([&] {
        if (!fits(*in)) return false;
        law_forward<T, Law>(*in, *result, threads);
        return true;
    });
}

KERNEL(law_adjoint)
(const LawInput<T>* in, const LawFields<const T>* incoming, const LawFields<T>* gradient, T* parameter_gradient,
 T* const* weights, int threads) {
    return guarded([&] {
        if (!fits(*in)) return false;
        law_adjoint<T, Law>(*in, *incoming, *gradient, parameter_gradient, weights, threads);
        return true;
    });
}

KERNEL(law_rates)
(const LawInput<T>* in, const LawFields<const T>* rate, const T* parameter_rate, const LawFields<T>* result,
 const LawFields<T>* result_rate, int threads) {
    return guarded([&] {
        if (!fits(*in)) return false;
        law_rates<T, Law>(*in, *rate, parameter_rate, *result, *result_rate, threads);
        return true;
    });
}
