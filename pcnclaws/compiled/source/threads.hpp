// The threads of a GPU. Compiled for a CPU, one after the other: the caller counts `thread` up.
#pragma once
#include "standard.hpp"

#ifdef __CUDACC_RTC__
#define KERNEL(name) extern "C" __global__ void name
inline int64_t thread_number() { return int64_t(blockIdx.x) * blockDim.x + threadIdx.x; }
#else
#define KERNEL(name) extern "C" __attribute__((visibility("default"))) void name
extern "C" {
__attribute__((visibility("default"))) int64_t thread = 0;
}
inline int64_t thread_number() { return thread; }
#endif
