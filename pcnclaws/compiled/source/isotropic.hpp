// A law on all particles: block after block.
#pragma once
#include <vector>

#include "law_block.hpp"
#include "network.hpp"
#include "parallel.hpp"

namespace pcnclaws {

constexpr int64_t TASK = 1024;  // particles of one task: the sum over tasks does not depend on the number of threads
static_assert(GROUPS * L == BLOCK, "a network's block of particles is that of a law");

template <class T, class Law> using Blocks = LawBlock<T, Law, NetworkBlock<T>>;

inline int64_t task_count(int64_t particles) { return (particles + TASK - 1) / TASK; }

// Runs visit(block) on every block of particles; visit may be told the task, to keep sums apart.
template <bool SLOPE, class T, class Law, class Visit>
void for_each_block(const LawInput<T>& in, int threads, Visit visit) {
    std::vector<PackedWeights<T>> packed;
    if (in.weights) packed.emplace_back(*in.weights, SLOPE);
    parallel_for(task_count(in.particles), threads, [&](int64_t task) {
        std::vector<NetworkBlock<T>> network;
        if (in.weights) network.emplace_back(packed[0]);
        Blocks<T, Law> block(in, in.weights ? &network[0] : nullptr);
        const int64_t last = std::min(in.particles, (task + 1) * TASK);
        for (int64_t first = task * TASK; first < last; first += BLOCK) {
            block.template enter<SLOPE>(first, std::min(first + BLOCK, last));
            visit(block, task);
        }
    });
}

template <class T, class Law> void law_forward(const LawInput<T>& in, const LawFields<T>& result, int threads) {
    for_each_block<false, T, Law>(in, threads, [&](Blocks<T, Law>& block, int64_t) {
        for (int group = 0; group < block.groups(); group++) {
            V y[Blocks<T, Law>::VALUES];
            block.respond(group, y);
            block.leave(group, y, result);
        }
    });
}

// gradients of the internal variables, of the parameters, and of the weights, as PyTorch keeps them: null where not wanted
template <class T, class Law>
void law_adjoint(const LawInput<T>& in, const LawFields<const T>& incoming, const LawFields<T>& gradient,
                 T* parameter_gradient, T* const* weight_gradients, int threads) {
    std::vector<WeightGradients<T>> sums;
    sums.reserve(size_t(task_count(in.particles)));
    if (weight_gradients && in.weights)
        for (int64_t task = 0; task < task_count(in.particles); task++) sums.emplace_back(*in.weights);
    for_each_block<true, T, Law>(in, threads, [&](Blocks<T, Law>& block, int64_t task) {
        typename Blocks<T, Law>::Adjoint adjoint[GROUPS];
        if constexpr (Blocks<T, Law>::NETWORK)
            std::fill(block.network->gradient[LAYERS].begin(), block.network->gradient[LAYERS].end(), T(0));
        for (int group = 0; group < block.groups(); group++)
            block.adjoint_first(group, incoming, adjoint[group], gradient.internal, parameter_gradient);
        if constexpr (Blocks<T, Law>::NETWORK) {
            // the last particle repeated beyond the end counts once
            T* end = block.network->gradient[LAYERS].data();
            const int stride = block.network->weights.padded[LAYERS];
            std::fill(end + (block.end - block.begin) * stride, end + BLOCK * stride, T(0));
            block.network->backward(sums.empty() ? nullptr : &sums[task]);
        }
        for (int group = 0; group < block.groups(); group++)
            block.adjoint_second(group, adjoint[group], gradient.matrix, parameter_gradient);
    });
    for (int l = 0; l < LAYERS && !sums.empty(); l++) {
        const int from = in.weights->sizes[l], to = in.weights->sizes[l + 1];
        const int padded = padded_size<T>(from);
        for (int o = 0; o < to; o++) {
            T total = 0;
            for (auto& sum : sums) total += sum.b[l][o];
            weight_gradients[LAYERS + l][o] = total;
            for (int i = 0; i < from; i++) {
                total = 0;
                for (auto& sum : sums) total += sum.w[l][size_t(o) * padded + i];
                weight_gradients[l][size_t(o) * from + i] = total;
            }
        }
    }
}

template <class T, class Law>
void law_rates(const LawInput<T>& in, const LawFields<const T>& rate, const T* parameter_rate,
               const LawFields<T>& result, const LawFields<T>& result_rate, int threads) {
    for_each_block<true, T, Law>(in, threads, [&](Blocks<T, Law>& block, int64_t) {
        typename Blocks<T, Law>::Rates rates[GROUPS];
        for (int group = 0; group < block.groups(); group++)
            block.rates_first(group, rate.matrix, parameter_rate, rates[group]);
        if constexpr (Blocks<T, Law>::NETWORK) block.network->rates();
        for (int group = 0; group < block.groups(); group++)
            block.rates_second(group, parameter_rate, rate.internal, rates[group], result, result_rate);
    });
}

}  // namespace pcnclaws
