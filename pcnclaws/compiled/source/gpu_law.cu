// The kernels of one law on a GPU, a thread for every particle. Given by macros: NUMBER, the type of the state; LAW, the
// ROWS of its parameters, and UNITS_1 and UNITS_2 of its network's hidden layers, 1 without a network; STAGED where its
// weights fit into the memory that the threads of a block share.
#include "law_block.hpp"
#include "thread_network.hpp"
#include "threads.hpp"

using namespace pcnclaws;
using T = NUMBER;
constexpr int INPUTS = LAW::FEATURES + ROWS - LAW::PARAMETERS;
using Network = ThreadNetwork<T, std::max(INPUTS, 1), UNITS_1, UNITS_2, std::max(LAW::OUTPUTS, 1)>;
#if defined(STAGED) && !defined(__CUDACC_RTC__)
alignas(32) double shared_memory[48 * 1024 / sizeof(double)];
#endif
using Block = LawBlock<T, LAW, Network>;

KERNEL(law_forward)
(int64_t particles, const T* deformation, const T* parameters, Weights<T> weights, T* result) {
    const int64_t p = thread_number();
    const Network::Given given(weights);
    given.fetch();
    if (p >= particles) return;
    const LawInput<T> in{particles, deformation, parameters, ROWS, nullptr};
    const NetworkMemory<T> none{};
    Network network(given, none, p);
    Block block(in, &network);
    block.template enter<false>(p, p + 1);
    V y[3];
    block.respond(0, y);
    block.leave(0, y, result);
}

// parameter_gradient null where it is not wanted. With a network, threads are as many as the memory has numbers in a row.
KERNEL(law_adjoint)
(int64_t particles, const T* deformation, const T* parameters, Weights<T> weights, const T* incoming, T* gradient,
 T* parameter_gradient, NetworkMemory<T> memory) {
    const int64_t p = thread_number();
    const Network::Given given(weights);
    given.fetch();
    Network network(given, memory, p);
    if (p >= particles) {
        if (p < memory.stride) network.clear();
        return;
    }
    const LawInput<T> in{particles, deformation, parameters, ROWS, nullptr};
    Block block(in, &network);
    typename Block::Adjoint adjoint;
    block.template enter<true>(p, p + 1);
    block.adjoint_first(0, incoming, adjoint, parameter_gradient);
    if constexpr (Block::NETWORK) network.backward();
    block.adjoint_second(0, adjoint, gradient, parameter_gradient);
}
