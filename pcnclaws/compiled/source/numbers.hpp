// What the transfer calculates with: plain numbers, or numbers with their rates of change, alone and four together.
#pragma once
#include "quads.hpp"

namespace pcnclaws {

// A number or a four-vector with its rate of change.
template <class U> struct Rate {
    U value, rate;
};
template <class U> Rate<U> operator+(Rate<U> a, Rate<U> b) { return {a.value + b.value, a.rate + b.rate}; }
template <class U> Rate<U> operator-(Rate<U> a, Rate<U> b) { return {a.value - b.value, a.rate - b.rate}; }
template <class A, class B> auto operator*(Rate<A> a, Rate<B> b) -> Rate<decltype(a.value * b.value)> {
    return {a.value * b.value, a.value * b.rate + a.rate * b.value};
}
template <class U> Rate<U> operator/(Rate<U> a, Rate<U> b) {
    const U quotient = a.value / b.value;
    return {quotient, (a.rate - quotient * b.rate) / b.value};
}
template <class U> Rate<U>& operator+=(Rate<U>& a, Rate<U> b) { return a = a + b; }
template <class U, class T> Rate<U> scaled(T factor, Rate<U> a) { return {factor * a.value, factor * a.rate}; }
inline float scaled(float factor, float a) { return factor * a; }
inline double scaled(double factor, double a) { return factor * a; }

template <class T> struct QuadOf<Rate<T>> {
    typedef Rate<typename QuadOf<T>::type> type;
};

template <class T> struct Plain {
    typedef T type;
};
template <class T> struct Plain<Rate<T>> {
    typedef T type;
};

inline float value_of(float a) { return a; }
inline double value_of(double a) { return a; }
template <class T> T value_of(Rate<T> a) { return a.value; }

template <class T> typename std::enable_if<std::is_floating_point<T>::value, Quad<T>>::type quad(T a, T b, T c, T d) {
    return Quad<T>{a, b, c, d};
}
template <class T> Quad<Rate<T>> quad(Rate<T> a, Rate<T> b, Rate<T> c, Rate<T> d) {
    return {Quad<T>{a.value, b.value, c.value, d.value}, Quad<T>{a.rate, b.rate, c.rate, d.rate}};
}
template <class Q> auto component(const Q& q, int k) -> decltype(q[0] + 0) { return q[k]; }
template <class Q> auto component(const Rate<Q>& q, int k) -> Rate<decltype(q.value[0] + 0)> {
    return {q.value[k], q.rate[k]};
}
template <class Q, class T> auto set_component(Q& q, int k, T a) -> decltype(q[0] = a, void()) { q[k] = a; }
template <class Q, class T> void set_component(Rate<Q>& q, int k, Rate<T> a) {
    q.value[k] = a.value;
    q.rate[k] = a.rate;
}

// A component-first array that is read or written as S: with its tangent array where S carries rates.
template <class S> struct Field {
    S* values;
    S get(int64_t k) const { return values[k]; }
    void set(int64_t k, S a) const { values[k] = a; }
};
template <class T> struct Field<Rate<T>> {
    T *values, *rates;
    Rate<T> get(int64_t k) const { return {values[k], rates[k]}; }
    void set(int64_t k, Rate<T> a) const {
        values[k] = a.value;
        rates[k] = a.rate;
    }
};

}  // namespace pcnclaws
