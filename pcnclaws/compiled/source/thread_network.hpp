// The network of network.hpp for one particle, by one thread of a GPU: the units of the first hidden layer stay in
// registers, and those of the second are used up as they come.
#pragma once
#include "law_input.hpp"

namespace pcnclaws {

// GELU x Phi(x) and its derivative, with the normal distribution Phi.
inline void gelu(float x, float& value, float& slope) {
    const float below = 0.5f * std::erfc(-0.70710678f * x);
    value = x * below;
    slope = below + x * (0.39894228f * std::exp(-0.5f * x * x));
}
inline void gelu(double x, double& value, double& slope) {
    const double below = 0.5 * std::erfc(-0.7071067811865476 * x);
    value = x * below;
    slope = below + x * (0.3989422804014327 * std::exp(-0.5 * x * x));
}

// IN, ONE, TWO, OUT: units of the layers.
template <class T, int IN, int ONE, int TWO, int OUT> struct ThreadNetwork {
    struct Ends {  // values or gradients at the first and the last layer
        T in[IN], out[OUT];
    };
    const Weights<T>& weights;
    int64_t particles, particle;
    // What the backward pass needs and the gradients of the weights are made of, unit after unit, each for all
    // particles; null in a forward pass. inputs: of the layers, the first one's, then those of the others, then 1.
    // gradients: at the outputs of the layers before GELU; until they are known, the slopes of GELU.
    T *inputs, *gradients;
    Ends unit{}, gradient{};

    ThreadNetwork(const Weights<T>& weights, int64_t particles, int64_t particle, T* inputs, T* gradients)
        : weights(weights), particles(particles), particle(particle), inputs(inputs), gradients(gradients) {}

    V get(const Ends& ends, int layer, int, int k) const { return V(layer == 0 ? ends.in[k] : ends.out[k]); }
    void put(Ends& ends, int layer, int, int k, V value) { (layer == 0 ? ends.in[k] : ends.out[k]) = T(value); }

    // unit.in to unit.out; SLOPE keeps what backward() needs
    template <bool SLOPE> void forward() {
        T one[ONE];
        for (int o = 0; o < ONE; o++) {
            T sum = weights.b[0][o];
            for (int i = 0; i < IN; i++) sum += weights.w[0][o * IN + i] * unit.in[i];
            one[o] = activated<SLOPE>(sum, IN + o, o);
        }
        for (int k = 0; k < OUT; k++) unit.out[k] = weights.b[2][k];
        // several sums side by side: one alone would wait for its last term
        constexpr int SIDE = TWO % 4 == 0 ? 4 : 1;
#pragma unroll 1
        for (int first = 0; first < TWO; first += SIDE) {
            T sum[SIDE];
            for (int s = 0; s < SIDE; s++) sum[s] = weights.b[1][first + s];
            for (int i = 0; i < ONE; i++)
                for (int s = 0; s < SIDE; s++) sum[s] += weights.w[1][(first + s) * ONE + i] * one[i];
            for (int s = 0; s < SIDE; s++) {
                const int o = first + s;
                const T value = activated<SLOPE>(sum[s], IN + ONE + o, ONE + o);
                for (int k = 0; k < OUT; k++) unit.out[k] += weights.w[2][k * TWO + o] * value;
            }
        }
        if (SLOPE) {
            for (int i = 0; i < IN; i++) keep(inputs, i, unit.in[i]);
            keep(inputs, IN + ONE + TWO, T(1));
        }
    }

    // gradient.out to gradient.in
    void backward() {
        T one[ONE]{};
#pragma unroll 1
        for (int o = 0; o < TWO; o++) {
            T sum = 0;
            for (int k = 0; k < OUT; k++) sum += weights.w[2][k * TWO + o] * gradient.out[k];
            sum = times_slope(sum, ONE + o);
            for (int i = 0; i < ONE; i++) one[i] += weights.w[1][o * ONE + i] * sum;
        }
        for (int i = 0; i < IN; i++) gradient.in[i] = 0;
        for (int o = 0; o < ONE; o++) {
            const T sum = times_slope(one[o], o);
            for (int i = 0; i < IN; i++) gradient.in[i] += weights.w[0][o * IN + i] * sum;
        }
        for (int k = 0; k < OUT; k++) keep(gradients, ONE + TWO + k, gradient.out[k]);
    }

  private:
    void keep(T* of, int row, T value) const {
        if (particle < particles) of[row * particles + particle] = value;
    }
    template <bool SLOPE> T activated(T x, int input_row, int slope_row) const {
        T value, slope;
        gelu(x, value, slope);
        if (SLOPE) {
            keep(inputs, input_row, value);
            keep(gradients, slope_row, slope);
        }
        return value;
    }
    T times_slope(T gradient, int row) const {
        if (particle >= particles) return T(0);
        T& kept = gradients[row * particles + particle];
        return kept *= gradient;
    }
};

}  // namespace pcnclaws
