// Four numbers at once: a vector of the compiler's, or on a GPU what one instruction loads.
#pragma once
#include "standard.hpp"

namespace pcnclaws {

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
template <class S> using Quad = typename QuadOf<S>::type;  // three components and one more

// Reads what no kernel writes: a GPU may read it early, and each number once for all threads.
#ifdef __CUDACC_RTC__
inline float read(const float* at) { return __ldg(at); }
inline double read(const double* at) { return __ldg(at); }
inline Four<float> read_four(const float* at) {
    const float4 four = __ldg(reinterpret_cast<const float4*>(at));
    return {{four.x, four.y, four.z, four.w}};
}
inline Four<double> read_four(const double* at) {
    const double2 low = __ldg(reinterpret_cast<const double2*>(at));
    const double2 high = __ldg(reinterpret_cast<const double2*>(at) + 1);
    return {{low.x, low.y, high.x, high.y}};
}
template <class T> Four<T> read(const Four<T>* at) { return read_four(&at->at[0]); }
#else
template <class T> T read(const T* at) { return *at; }
template <class T> Quad<T> read_four(const T* at) { return Quad<T>{at[0], at[1], at[2], at[3]}; }
#endif

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

}  // namespace pcnclaws
