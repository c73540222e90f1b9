// Independent tasks on the threads of OpenMP, or one after the other where the compiler has none.
#pragma once
#include <cstdint>

namespace pcnclaws {

template <class Task> void parallel_for(int64_t count, int threads, Task task) {
#ifdef _OPENMP
    if (threads > 1 && count > 1) {
#pragma omp parallel for num_threads(threads) schedule(dynamic)
        for (int64_t k = 0; k < count; k++) task(k);
        return;
    }
#endif
    (void)threads;
    for (int64_t k = 0; k < count; k++) task(k);
}

}  // namespace pcnclaws
