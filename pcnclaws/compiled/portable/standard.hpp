// What the kernels need of the standard library, without extensions of a compiler.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <type_traits>

#ifdef __FAST_MATH__
#error "compensated sums and infinities need IEEE arithmetic: compile without -ffast-math"
#endif

namespace pcnclaws {

using std::int64_t;

[[noreturn]] inline void stop() { std::abort(); }
inline void count_fallback() {}

}  // namespace pcnclaws
