// What stands in lanes.hpp for a GPU, where every thread has one particle: vectors of one number.
#pragma once
#include "standard.hpp"

namespace pcnclaws {

using V = double;
using Mask = bool;
constexpr int L = 1;

inline V splat(double x) { return x; }
inline V select(Mask mask, V yes, V no) { return mask ? yes : no; }
inline V maximum(V a, V b) { return a > b ? a : b; }
inline V minimum(V a, V b) { return a < b ? a : b; }
inline V absolute(V a) { return maximum(a, -a); }
inline bool any(Mask mask) { return mask; }
template <class To, class From> To converted(From a) { return To(a); }
inline double lane_of(V a, int) { return a; }
inline bool lane_of(Mask mask, int) { return mask; }
inline void set_lane(V& a, int, double x) { a = x; }

inline float square_root_of_lanes(float a) { return std::sqrt(a); }
inline V square_root_of_lanes(V a) { return std::sqrt(a); }
inline V square_root(V a) { return std::sqrt(a); }
inline V exponential(V x) { return std::exp(x < -700.0 ? -700.0 : x > 700.0 ? 700.0 : x); }
inline V logarithm(V x) { return std::log(x); }

template <class T> V load(const T* row, int64_t first, int64_t end) { return V(row[first < end ? first : end - 1]); }
template <class T> void store(T* row, int64_t first, int64_t end, V values) {
    if (first < end) row[first] = T(values);
}

typedef float Singles;
typedef float Half;
constexpr int HALVES = 1;
inline void put_half(Singles& whole, int, V values) { whole = float(values); }
inline V get_half(const Singles& whole, int) { return V(whole); }

}  // namespace pcnclaws
