// How many particles found their principal axes by the slow path, since the kernels were loaded.
#pragma once
#include "standard.hpp"

#ifdef __CUDACC_RTC__

extern "C" __device__ unsigned long long fallbacks = 0;

namespace pcnclaws {
inline void count_fallback() { atomicAdd(&fallbacks, 1ull); }
}  // namespace pcnclaws

#else

#include <atomic>

// weak and not inline: an inline one would be the same for all libraries of a process
extern "C" {
__attribute__((visibility("default"), weak)) std::atomic<int64_t> fallbacks{0};
}

namespace pcnclaws {
inline void count_fallback() { fallbacks.fetch_add(1, std::memory_order_relaxed); }
}  // namespace pcnclaws

#endif
