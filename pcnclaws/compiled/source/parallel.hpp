// Independent tasks on the threads of OpenMP, or one after the other where the compiler has none.
#pragma once
#include <atomic>
#include <cstdint>
#include <new>

namespace pcnclaws {

template <class Task> void parallel_for(int64_t count, int threads, Task task) {
#ifdef _OPENMP
    if (threads > 1 && count > 1) {
        std::atomic<bool> out_of_memory{false};
#pragma omp parallel for num_threads(threads) schedule(dynamic)
        for (int64_t k = 0; k < count; k++) {
            try {
                task(k);
            } catch (const std::bad_alloc&) {  // must not leave the thread that met it
                out_of_memory = true;
            }
        }
        if (out_of_memory) throw std::bad_alloc();
        return;
    }
#endif
    (void)threads;
    for (int64_t k = 0; k < count; k++) task(k);
}

}  // namespace pcnclaws
