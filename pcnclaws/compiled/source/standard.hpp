// What the kernels need of the standard library. NVRTC, which compiles for a GPU, has none.
#pragma once
#ifndef __CUDACC_RTC__

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

inline void stop() { __builtin_trap(); }
#define IN_ONE_FUNCTION __attribute__((flatten))
#define SLOW_PATH __attribute__((noinline, cold))
#define CALLS_SLOW_PATH SLOW_PATH inline

#else

inline void stop() { __trap(); }
#define IN_ONE_FUNCTION
#define SLOW_PATH __noinline__
// what a function is given by address leaves the registers
#define CALLS_SLOW_PATH __forceinline__

typedef long long int64_t;
typedef unsigned long long uint64_t;
#define NAN nan("")

namespace std {

using ::erf;
using ::erfc;
using ::exp;
using ::fabs;
using ::floor;
using ::fma;
using ::frexp;
using ::ldexp;
using ::log;
using ::sqrt;

template <class T> constexpr T min(T a, T b) { return b < a ? b : a; }
template <class T> constexpr T max(T a, T b) { return a < b ? b : a; }

template <bool, class T = void> struct enable_if {};
template <class T> struct enable_if<true, T> {
    typedef T type;
};
template <bool CONDITION, class T> using enable_if_t = typename enable_if<CONDITION, T>::type;

template <class T> struct is_class {
    static constexpr bool value = __is_class(T);
};
template <class T> struct is_floating_point {
    static constexpr bool value = false;
};
template <> struct is_floating_point<float> {
    static constexpr bool value = true;
};
template <> struct is_floating_point<double> {
    static constexpr bool value = true;
};

template <class T> struct numeric_limits;
template <> struct numeric_limits<int> {
    static constexpr int max() { return 0x7fffffff; }
};
template <> struct numeric_limits<float> {
    static constexpr float min() { return 1.17549435e-38f; }
};
template <> struct numeric_limits<double> {
    static constexpr double min() { return 2.2250738585072014e-308; }
};

}  // namespace std

#endif
