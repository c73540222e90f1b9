// The kernels of one law, law.hpp, on a GPU, a thread for every particle. Given by macros: NUMBER, the type of the state;
// UNITS_0 to UNITS_3 of its network's layers, 0 without a network; STAGED where its weights fit into the memory that the
// threads of a block share.
#include "law_block.hpp"
#include "thread_network.hpp"
#include "threads.hpp"

using namespace pcnclaws;
using T = NUMBER;
constexpr int INPUTS = Law::FEATURES ? Law::FEATURES + PARAMETER_ROWS - Law::PARAMETERS : 0;
static_assert(UNITS_0 == INPUTS && UNITS_3 == Law::OUTPUTS, "the network must fit the law");
static_assert(Law::FEATURES == 0 || LAYERS == 3, "a thread's network has two hidden layers");
// an array has at least one number
using Network =
    ThreadNetwork<T, std::max(UNITS_0, 1), std::max(UNITS_1, 1), std::max(UNITS_2, 1), std::max(UNITS_3, 1)>;
#if defined(STAGED) && !defined(__CUDACC_RTC__)
alignas(32) double shared_memory[(Network::Given::TOTAL * sizeof(T) + 7) / 8];
#endif
using Block = LawBlock<T, Law, Network>;

KERNEL(law_forward)
(int64_t particles, const T* deformation, const T* parameters, const T* internal, Weights<T> weights,
 LawFields<T> result) {
    const int64_t p = thread_number();
    const Network::Given given(weights);
    given.fetch();
    if (p >= particles) return;
    const LawInput<T> in{particles, deformation, parameters, PARAMETER_ROWS, nullptr, internal};
    const NetworkMemory<T> none{};
    Network network(given, none, p);
    Block block(in, &network);
    block.template enter<false>(p, p + 1);
    V y[Block::VALUES];
    block.respond(0, y);
    block.leave(0, y, result);
}

// parameter_gradient null where it is not wanted. With a network, threads are as many as the memory has numbers in a row.
KERNEL(law_adjoint)
(int64_t particles, const T* deformation, const T* parameters, const T* internal, Weights<T> weights,
 LawFields<const T> incoming, LawFields<T> gradient, T* parameter_gradient, NetworkMemory<T> memory) {
    const int64_t p = thread_number();
    const Network::Given given(weights);
    given.fetch();
    Network network(given, memory, p);
    if (p >= particles) {
        if (p < memory.stride) network.clear();
        return;
    }
    const LawInput<T> in{particles, deformation, parameters, PARAMETER_ROWS, nullptr, internal};
    Block block(in, &network);
    typename Block::Adjoint adjoint;
    block.template enter<true>(p, p + 1);
    block.adjoint_first(0, incoming, adjoint, gradient.internal, parameter_gradient);
    if constexpr (Block::NETWORK) network.backward();
    block.adjoint_second(0, adjoint, gradient.matrix, parameter_gradient);
}
