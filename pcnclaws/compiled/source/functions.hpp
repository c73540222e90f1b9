// Functions of whatever a law is evaluated with: plain values, or values that carry derivatives (Dual, Taped), which
// provide value_of, constant, chain, select and the four operations.
#pragma once
#include "lanes.hpp"
#include "tape.hpp"

namespace pcnclaws {

// log(1 + e^x)
inline V softplus(V x) { return maximum(x, V{}) + logarithm(1.0 + exponential(-absolute(x))); }

// tanh x, which is x where it is small
inline V tangent(V x) {
    const V square = x * x, power = exponential(2.0 * x);
    return select(square < 1e-6, x * (1.0 - square / 3.0), (power - 1.0) / (power + 1.0));
}

}  // namespace pcnclaws
