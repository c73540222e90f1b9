// What the transfer calculates with: plain numbers, or numbers with their rates of change, alone and four together.
#pragma once
#include "standard.hpp"

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

#ifdef __CUDACC_RTC__
template <class T> struct alignas(4 * sizeof(T)) Four {
    T at[4];
    T operator[](int k) const { return at[k]; }
    T& operator[](int k) { return at[k]; }
};
template <class T> Four<T> operator+(Four<T> a, Four<T> b) {
    return {{a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]}};
}
template <class T> Four<T> operator-(Four<T> a, Four<T> b) {
    return {{a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]}};
}
template <class T> Four<T> operator*(Four<T> a, T b) { return {{a[0] * b, a[1] * b, a[2] * b, a[3] * b}}; }
template <class T> Four<T> operator*(T a, Four<T> b) { return b * a; }
template <class T> Four<T> operator*(Four<T> a, Four<T> b) {
    return {{a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3]}};
}
template <class T> Four<T>& operator+=(Four<T>& a, Four<T> b) { return a = a + b; }
template <class T> struct QuadOf {
    typedef Four<T> type;
};
#else
template <class T> struct QuadOf {
    typedef T type __attribute__((vector_size(4 * sizeof(T))));
};
#endif
template <class T> struct QuadOf<Rate<T>> {
    typedef Rate<typename QuadOf<T>::type> type;
};
template <class S> using Quad = typename QuadOf<S>::type;  // three components and one more

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

// Adds to a node, which many threads of a GPU do at once.
#ifdef __CUDACC_RTC__
template <class T> void add_to(Four<T>& node, Four<T> a) {
    for (int k = 0; k < 4; k++) atomicAdd(&node[k], a[k]);
}
#if __CUDA_ARCH__ >= 900
inline void add_to(Four<float>& node, Four<float> a) {
    atomicAdd(reinterpret_cast<float4*>(&node), make_float4(a[0], a[1], a[2], a[3]));
}
#endif
#else
template <class Q> void add_to(Q& node, Q a) { node += a; }
#endif

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
