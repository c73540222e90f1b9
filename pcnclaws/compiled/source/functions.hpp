// Functions of whatever a law is evaluated with: plain values, or values that carry derivatives (Dual, Taped), which
// provide value_of, constant, chain, select and the four operations.
#pragma once
#include "lanes.hpp"
#include "tape.hpp"

namespace pcnclaws {

template <class S> using Differentiated = std::enable_if_t<std::is_class<S>::value, S>;

template <class S> Differentiated<S> operator-(const S& a) { return chain(a, -a.value, splat(-1.0)); }
template <class S> Differentiated<S> operator+(const S& a, double b) { return chain(a, a.value + b, splat(1.0)); }
template <class S> Differentiated<S> operator-(const S& a, double b) { return chain(a, a.value - b, splat(1.0)); }
template <class S> Differentiated<S> operator*(const S& a, double b) { return chain(a, a.value * b, splat(b)); }
template <class S> Differentiated<S> operator*(double b, const S& a) { return a * b; }
template <class S> Differentiated<S> operator/(const S& a, double b) { return a * (1.0 / b); }

template <class S> Differentiated<S> maximum(const S& a, const S& b) { return select(a.value >= b.value, a, b); }
template <class S> Differentiated<S> minimum(const S& a, const S& b) { return select(a.value <= b.value, a, b); }

template <class S> S square(const S& a) { return a * a; }

template <class S> Differentiated<S> square_root(const S& a) {
    const V root = square_root(a.value);
    return chain(a, root, 0.5 / root);
}

template <class S> Differentiated<S> exponential(const S& a) {
    const V value = exponential(a.value);
    return chain(a, value, value);
}

// log(1 + e^x)
inline V softplus(V x) { return maximum(x, V{}) + logarithm(1.0 + exponential(-absolute(x))); }
template <class S> Differentiated<S> softplus(const S& a) {
    return chain(a, softplus(a.value), 1.0 / (1.0 + exponential(-a.value)));
}

// The root of a sum of squares, with derivative 0 where it is 0.
template <class S> S safe_root(const S& squared) {
    const Mask positive = value_of(squared) > 0.0;
    const S zero = constant(V{}, squared);
    return select(positive, square_root(select(positive, squared, zero + 1.0)), zero);
}

}  // namespace pcnclaws
