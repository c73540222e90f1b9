// The network of network.hpp for one particle, by one thread of a GPU: the units of the first hidden layer stay in
// registers, and those of the second are used up as they come.
#pragma once
#include "law_input.hpp"
#include "quads.hpp"
#include "threads.hpp"

#ifdef STAGED
extern SHARED double shared_memory[];
#endif

namespace pcnclaws {

// GELU x Phi(x) and its derivative, with the normal distribution Phi.
inline void gelu(float x, float& value, float& slope) {
    const float below = 0.5f + 0.5f * std::erf(0.70710678f * x);
    value = x * below;
    slope = below + x * (0.39894228f * std::exp(-0.5f * x * x));
}
inline void gelu(double x, double& value, double& slope) {
    const double below = 0.5 * std::erfc(-0.7071067811865476 * x);
    value = x * below;
    slope = below + x * (0.3989422804014327 * std::exp(-0.5 * x * x));
}

// The weights of a network with so many units, from where a thread reads them. Each is read once by every thread, and
// waiting for the memory of the GPU each time would take longer than all else: the threads of a block fetch them together
// into the memory that they share, unless there are too many (no STAGED).
template <class T, int IN, int ONE, int TWO, int OUT> class NetworkWeights {
  public:
    explicit NetworkWeights(const Weights<T>& weights) : weights(weights) {}

    T weight(int layer, int at) const { return get(2 * layer, weights.w[layer], at); }
    T bias(int layer, int at) const { return get(2 * layer + 1, weights.b[layer], at); }
    // Runs visit(k, weight k) for a row of the second layer, four at a time where that is possible.
    template <class Visit> void each_of_row(int row, Visit visit) const {
        if constexpr (ONE % 4 == 0) {
#pragma unroll
            for (int k = 0; k < ONE; k += 4) {
                const Quad<T> four = get_four(row * ONE + k);
#pragma unroll
                for (int n = 0; n < 4; n++) visit(k + n, four[n]);
            }
        } else {
#pragma unroll
            for (int k = 0; k < ONE; k++) visit(k, weight(1, row * ONE + k));
        }
    }

  private:
    const Weights<T>& weights;

#ifdef STAGED
    // numbers of the parts: weights and biases of the layers in turn; where they begin, at whole quads
    static constexpr int SIZES[] = {IN * ONE, ONE, ONE * TWO, TWO, TWO * OUT, OUT};
    static constexpr int begin(int part) {
        int sum = 0;
        for (int k = 0; k < part; k++) sum += (SIZES[k] + 3) / 4 * 4;
        return sum;
    }
    static T* shared() { return reinterpret_cast<T*>(shared_memory); }
    static T get(int part, const T*, int at) { return shared()[begin(part) + at]; }
    static Quad<T> get_four(int at) { return *reinterpret_cast<const Quad<T>*>(shared() + begin(2) + at); }

    // Many numbers are on their way at once: waiting for each would take longer than all of the network.
    template <class U> static void copy(const U* from, U* to, int count) {
        constexpr int TOGETHER = 16;
        const int threads = int(blockDim.x);
        for (int first = int(threadIdx.x); first < count; first += TOGETHER * threads) {
            U held[TOGETHER];
#pragma unroll
            for (int n = 0; n < TOGETHER; n++)
                if (first + n * threads < count) held[n] = read(from + first + n * threads);
#pragma unroll
            for (int n = 0; n < TOGETHER; n++)
                if (first + n * threads < count) to[first + n * threads] = held[n];
        }
    }

  public:
    static constexpr int TOTAL = begin(2 * LAYERS);  // numbers that the threads of a block share

    // to be called by all threads of a block
    void fetch() const {
#pragma unroll
        for (int part = 0; part < 2 * LAYERS; part++) {
            const T* from = part % 2 ? weights.b[part / 2] : weights.w[part / 2];
            T* to = shared() + begin(part);
            if (SIZES[part] % 4 == 0)
                copy(reinterpret_cast<const Quad<T>*>(from), reinterpret_cast<Quad<T>*>(to), SIZES[part] / 4);
            else
                copy(from, to, SIZES[part]);
        }
        wait_for_block();
    }
#else
    static T get(int, const T* from, int at) { return read(from + at); }
    Quad<T> get_four(int at) const { return read_four(weights.w[1] + at); }

  public:
    void fetch() const {}
#endif
};

// What the gradients of the weights are made of, unit after unit, each for all particles; null where they are not wanted.
//
// inputs     of the layers: the first one's, then those of the others, then 1
// gradients  at the outputs of the layers, before GELU
// stride     from unit to unit; beyond the particles there are zeros
template <class T> struct NetworkMemory {
    T *inputs, *gradients;
    int64_t stride;
};

// IN, ONE, TWO, OUT: units of the layers.
template <class T, int IN, int ONE, int TWO, int OUT> struct ThreadNetwork {
    struct Ends {  // values or gradients at the first and the last layer
        T in[IN], out[OUT];
    };
    typedef NetworkWeights<T, IN, ONE, TWO, OUT> Given;
    const Given& weights;
    const NetworkMemory<T>& memory;
    int64_t particle;
    Ends unit{}, gradient{};
    T slope_one[ONE], slope_two[TWO];  // of GELU

    ThreadNetwork(const Given& weights, const NetworkMemory<T>& memory, int64_t particle)
        : weights(weights), memory(memory), particle(particle) {}

    V get(const Ends& ends, int layer, int, int k) const { return V(layer == 0 ? ends.in[k] : ends.out[k]); }
    void put(Ends& ends, int layer, int, int k, V value) { (layer == 0 ? ends.in[k] : ends.out[k]) = T(value); }

    // unit.in to unit.out; SLOPE keeps what backward() and the gradients of the weights need
    template <bool SLOPE> void forward() {
        T in[IN], one[ONE], out[OUT];
#pragma unroll
        for (int i = 0; i < IN; i++) in[i] = unit.in[i];
#pragma unroll
        for (int o = 0; o < ONE; o++) {
            T sum = weights.bias(0, o), slope;
#pragma unroll
            for (int i = 0; i < IN; i++) sum += weights.weight(0, o * IN + i) * in[i];
            gelu(sum, one[o], slope);
            if (SLOPE) {
                slope_one[o] = slope;
                keep(memory.inputs, IN + o, one[o]);
            }
        }
#pragma unroll
        for (int k = 0; k < OUT; k++) out[k] = weights.bias(2, k);
        // several sums side by side: one alone would wait for its last term
        constexpr int SIDE = TWO % 4 == 0 ? 4 : 1;
#pragma unroll 1
        for (int first = 0; first < TWO; first += SIDE) {
            T sum[SIDE];
#pragma unroll
            for (int s = 0; s < SIDE; s++) {
                sum[s] = weights.bias(1, first + s);
                weights.each_of_row(first + s, [&](int i, T w) { sum[s] += w * one[i]; });
            }
#pragma unroll
            for (int s = 0; s < SIDE; s++) {
                const int o = first + s;
                T value, slope;
                gelu(sum[s], value, slope);
                if (SLOPE) {
                    slope_two[o] = slope;
                    keep(memory.inputs, IN + ONE + o, value);
                }
#pragma unroll
                for (int k = 0; k < OUT; k++) out[k] += weights.weight(2, k * TWO + o) * value;
            }
        }
#pragma unroll
        for (int k = 0; k < OUT; k++) unit.out[k] = out[k];
        if (SLOPE) {
#pragma unroll
            for (int i = 0; i < IN; i++) keep(memory.inputs, i, in[i]);
            keep(memory.inputs, IN + ONE + TWO, T(1));
        }
    }

    // gradient.out to gradient.in
    void backward() {
        T one[ONE]{}, in[IN]{}, out[OUT];
#pragma unroll
        for (int k = 0; k < OUT; k++) out[k] = gradient.out[k];
#pragma unroll 2
        for (int o = 0; o < TWO; o++) {
            T sum = 0;
#pragma unroll
            for (int k = 0; k < OUT; k++) sum += weights.weight(2, k * TWO + o) * out[k];
            sum *= slope_two[o];
            keep(memory.gradients, ONE + o, sum);
            weights.each_of_row(o, [&](int i, T w) { one[i] += w * sum; });
        }
#pragma unroll
        for (int o = 0; o < ONE; o++) {
            const T sum = one[o] * slope_one[o];
            keep(memory.gradients, o, sum);
#pragma unroll
            for (int i = 0; i < IN; i++) in[i] += weights.weight(0, o * IN + i) * sum;
        }
#pragma unroll
        for (int k = 0; k < OUT; k++) keep(memory.gradients, ONE + TWO + k, out[k]);
#pragma unroll
        for (int i = 0; i < IN; i++) gradient.in[i] = in[i];
    }

    // what stands in the memory beyond the particles
    void clear() const {
        for (int row = 0; row <= IN + ONE + TWO; row++) keep(memory.inputs, row, T(0));
        for (int row = 0; row < ONE + TWO + OUT; row++) keep(memory.gradients, row, T(0));
    }

  private:
    void keep(T* of, int row, T value) const {
        if (of) of[row * memory.stride + particle] = value;
    }
};

}  // namespace pcnclaws
