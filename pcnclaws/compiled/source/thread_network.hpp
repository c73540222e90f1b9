// The network of network.hpp for one particle, by one thread of a GPU: the units of the first hidden layer stay in
// registers, and those of the second are used up as they come.
#pragma once
#include "law_input.hpp"
#include "quads.hpp"

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

// Runs visit(k, weight k) for the weights of a row, which are read four at a time where their number allows.
template <int COUNT, class T, class Visit> void each_weight(const T* row, Visit visit) {
    if constexpr (COUNT % 4 == 0) {
#pragma unroll
        for (int k = 0; k < COUNT; k += 4) {
            const Quad<T> four = read_four(row + k);
#pragma unroll
            for (int n = 0; n < 4; n++) visit(k + n, four[n]);
        }
    } else {
#pragma unroll
        for (int k = 0; k < COUNT; k++) visit(k, read(row + k));
    }
}

// What the backward pass needs and the gradients of the weights are made of, unit after unit, each for all particles.
//
// inputs     of the layers: the first one's, then those of the others, then 1
// gradients  at the outputs of the layers, before GELU
// stride     from unit to unit; beyond the particles there are zeros
template <class T> struct NetworkMemory {
    T *inputs, *gradients;
    int64_t stride;
};

// IN, ONE, TWO, OUT: units of the layers. The rows of weights begin at whole quads.
template <class T, int IN, int ONE, int TWO, int OUT> struct ThreadNetwork {
    struct Ends {  // values or gradients at the first and the last layer
        T in[IN], out[OUT];
    };
    const Weights<T>& weights;
    const NetworkMemory<T>& memory;
    int64_t particle;
    Ends unit{}, gradient{};
    T slope_one[ONE], slope_two[TWO];  // of GELU

    ThreadNetwork(const Weights<T>& weights, const NetworkMemory<T>& memory, int64_t particle)
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
            T sum = read(weights.b[0] + o), slope;
#pragma unroll
            for (int i = 0; i < IN; i++) sum += read(weights.w[0] + o * IN + i) * in[i];
            gelu(sum, one[o], slope);
            if (SLOPE) {
                slope_one[o] = slope;
                keep(memory.inputs, IN + o, one[o]);
            }
        }
#pragma unroll
        for (int k = 0; k < OUT; k++) out[k] = read(weights.b[2] + k);
        // several sums side by side: one alone would wait for its last term
        constexpr int SIDE = TWO % 4 == 0 ? 4 : 1;
#pragma unroll 1
        for (int first = 0; first < TWO; first += SIDE) {
            T sum[SIDE];
#pragma unroll
            for (int s = 0; s < SIDE; s++) {
                sum[s] = read(weights.b[1] + first + s);
                each_weight<ONE>(weights.w[1] + (first + s) * ONE, [&](int i, T w) { sum[s] += w * one[i]; });
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
                for (int k = 0; k < OUT; k++) out[k] += read(weights.w[2] + k * TWO + o) * value;
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
            for (int k = 0; k < OUT; k++) sum += read(weights.w[2] + k * TWO + o) * out[k];
            sum *= slope_two[o];
            keep(memory.gradients, ONE + o, sum);
            each_weight<ONE>(weights.w[1] + o * ONE, [&](int i, T w) { one[i] += w * sum; });
        }
#pragma unroll
        for (int o = 0; o < ONE; o++) {
            const T sum = one[o] * slope_one[o];
            keep(memory.gradients, o, sum);
#pragma unroll
            for (int i = 0; i < IN; i++) in[i] += read(weights.w[0] + o * IN + i) * sum;
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
    void keep(T* of, int row, T value) const { of[row * memory.stride + particle] = value; }
};

}  // namespace pcnclaws
