// The threads of a GPU. Compiled for a CPU, one after the other, each a block of its own: the caller counts `thread` up.
#pragma once
#include "standard.hpp"

#ifdef __CUDACC_RTC__
#define KERNEL(name) extern "C" __global__ void name
#define SHARED __shared__ __align__(32)
inline int64_t thread_number() { return int64_t(blockIdx.x) * blockDim.x + threadIdx.x; }
inline void wait_for_block() { __syncthreads(); }
#else
#define KERNEL(name) extern "C" __attribute__((visibility("default"))) void name
#define SHARED
extern "C" {
__attribute__((visibility("default"))) int64_t thread = 0;
}
constexpr struct {
    unsigned x;
} threadIdx{0}, blockDim{1};
inline int64_t thread_number() { return thread; }
inline void wait_for_block() {}
#endif
