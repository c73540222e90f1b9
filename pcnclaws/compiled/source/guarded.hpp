// What the functions share that Python calls: plain C, whose names end with the precision that they are compiled for, by
// NUMBER, its type, and PRECISION, the end of the names.
#pragma once
#include <new>

namespace pcnclaws {

// What a kernel returns; nothing may be thrown through C.
enum Status { DONE, REFUSED, OUT_OF_MEMORY };

template <class Work> int guarded(Work work) {
    try {
        return work() ? DONE : REFUSED;
    } catch (const std::bad_alloc&) {
        return OUT_OF_MEMORY;
    }
}

}  // namespace pcnclaws

#define JOINED(name, precision) name##_##precision
#define EXPANDED(name, precision) JOINED(name, precision)
#define KERNEL(name) extern "C" __attribute__((visibility("default"))) int EXPANDED(name, PRECISION)
