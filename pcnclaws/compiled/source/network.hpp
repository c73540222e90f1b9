// A multilayer perceptron with two hidden layers and GELU, block of particles by block, so that the activations stay in
// the cache. Particle-major: the units of a layer are the lanes.
#pragma once
#include <vector>

#include "lanes.hpp"

namespace pcnclaws {

constexpr int LAYERS = 3;
constexpr int BLOCK = 32;  // particles

template <class T> Vector<T> load_vector(const T* from) {
    Vector<T> out;
    std::memcpy(&out, from, sizeof out);
    return out;
}
template <class T> void store_vector(T* to, Vector<T> values) { std::memcpy(to, &values, sizeof values); }

// y[r][:] = start[r][:] + sum_k x[r][k] w[k][:] for ROWS rows and COLUMNS vectors of columns, in registers. x is read
// with the strides (row, step), so that it may be a transpose.
template <class T, int ROWS, int COLUMNS>
void product_tile(const T* x, int row, int step, const T* w, int w_row, int count, const T* start, int start_row, T* y,
                  int y_row) {
    Vector<T> sum[ROWS][COLUMNS];
    for (int r = 0; r < ROWS; r++)
        for (int c = 0; c < COLUMNS; c++)
            sum[r][c] = start ? load_vector(start + r * start_row + c * LANES<T>) : Vector<T>{};
    for (int k = 0; k < count; k++) {
        Vector<T> wk[COLUMNS];
        for (int c = 0; c < COLUMNS; c++) wk[c] = load_vector(w + k * w_row + c * LANES<T>);
        for (int r = 0; r < ROWS; r++) {
            const T xk = x[r * row + k * step];
            for (int c = 0; c < COLUMNS; c++) sum[r][c] += xk * wk[c];
        }
    }
    for (int r = 0; r < ROWS; r++)
        for (int c = 0; c < COLUMNS; c++) store_vector(y + r * y_row + c * LANES<T>, sum[r][c]);
}

// The whole product: `rows` a multiple of ROWS, `columns` a multiple of the lanes.
constexpr int ROWS = BYTES == 64 ? 8 : 4;  // the sums of a tile stay in registers: 32 of 64 bytes, or 16 narrower ones
template <class T>
void product(int rows, int columns, int count, const T* x, int row, int step, const T* w, const T* start, int start_row,
             T* y) {
    int c = 0;
    for (; c + 2 * LANES<T> <= columns; c += 2 * LANES<T>)
        for (int r = 0; r < rows; r += ROWS)
            product_tile<T, ROWS, 2>(x + r * row, row, step, w + c, columns, count,
                                     start ? start + r * start_row + c : nullptr, start_row, y + r * columns + c,
                                     columns);
    for (; c < columns; c += LANES<T>)
        for (int r = 0; r < rows; r += ROWS)
            product_tile<T, ROWS, 1>(x + r * row, row, step, w + c, columns, count,
                                     start ? start + r * start_row + c : nullptr, start_row, y + r * columns + c,
                                     columns);
}

// GELU x Phi(x) and its derivative Phi(x) + x phi(x). In single precision both are 1/2 plus an odd function, here x
// times a polynomial in x^2 fitted on |x| < 5.4, beyond which they are 0 and 1: right to 2e-7 for the normal
// distribution Phi.
constexpr float GELU_RANGE = 5.4f;
constexpr float CDF[] = {0.000376044092f, -0.00102007787f, 0.000929660053f, -0.00121130003f, 0.00358935175f,
                         -0.00668679878f, 0.00969475472f,  -0.0139788988f,  0.0196312566f,   -0.0257423645f,
                         0.0321186832f,   -0.0392072682f,  0.0484994752f,   -0.0653280406f,  0.130928114f};
constexpr float CDF_SLOPE[] = {-0.000614703004f, 0.00178587977f, -0.00164043932f, 0.00217324849f, -0.00771962647f,
                               0.015642193f,     -0.0232468863f, 0.0343909242f,   -0.0495748221f, 0.0638123765f,
                               -0.0733549556f,   0.0763494428f,  -0.0723938546f,  0.0641514241f,  -0.0567882414f,
                               0.0557328357f,    -0.0673123449f, 0.13120032f};

template <int COUNT> Vector<float> odd_part(const float (&fitted)[COUNT], Vector<float> x, Vector<float> t) {
    Vector<float> sum = Vector<float>{} + fitted[0];
    for (int k = 1; k < COUNT; k++) sum = sum * t + fitted[k];
    return x * sum;
}
inline void gelu(Vector<float> x, Vector<float>& value, Vector<float>* slope) {
    const Vector<float> range = Vector<float>{} + GELU_RANGE;
    Vector<float> inside = x < range ? x : range;
    inside = inside > -range ? inside : -range;
    const Vector<float> t = inside * inside * (2.0f / (GELU_RANGE * GELU_RANGE)) - 1.0f;
    if (slope) *slope = 0.5f + odd_part(CDF_SLOPE, inside, t);
    value = x * (0.5f + odd_part(CDF, inside, t));
}
inline void gelu(Vector<double> x, Vector<double>& value, Vector<double>* slope) {
    Vector<double> below;
    for (int l = 0; l < LANES<double>; l++) below[l] = 0.5 * std::erfc(-0.7071067811865476 * x[l]);
    value = x * below;
    if (slope) *slope = below + x * exponential(-0.5 * x * x) * 0.3989422804014327;
}

// GELU of an array in place, and its derivative where it is wanted.
template <bool SLOPE, class T> void gelu(int count, T* x, T* slope) {
    for (int k = 0; k < count; k += LANES<T>) {
        Vector<T> value, rate;
        gelu(load_vector(x + k), value, SLOPE ? &rate : nullptr);
        store_vector(x + k, value);
        if (SLOPE) store_vector(slope + k, rate);
    }
}

// The weights as PyTorch keeps them: w[l] is (sizes[l + 1], sizes[l]), row-major.
template <class T> struct Weights {
    const T *w[LAYERS], *b[LAYERS];
    int sizes[LAYERS + 1];
};

// The weights padded to whole vectors, in the orders of the passes forward and backward.
template <class T> struct PackedWeights {
    int sizes[LAYERS + 1], padded[LAYERS + 1];
    std::vector<T> forward[LAYERS], backward[LAYERS], bias[LAYERS];

    explicit PackedWeights(const Weights<T>& weights) {
        for (int l = 0; l <= LAYERS; l++) {
            sizes[l] = weights.sizes[l];
            padded[l] = (sizes[l] + LANES<T> - 1) / LANES<T> * LANES<T>;
        }
        for (int l = 0; l < LAYERS; l++) {
            const int from = sizes[l], to = sizes[l + 1];
            forward[l].assign(size_t(from) * padded[l + 1], T(0));
            backward[l].assign(size_t(to) * padded[l], T(0));
            bias[l].assign(padded[l + 1], T(0));
            for (int o = 0; o < to; o++) {
                bias[l][o] = weights.b[l][o];
                for (int i = 0; i < from; i++)
                    forward[l][size_t(i) * padded[l + 1] + o] = backward[l][size_t(o) * padded[l] + i] =
                        weights.w[l][size_t(o) * from + i];
            }
        }
    }
};

// Gradients of the weights, padded, (to rounded up to ROWS, padded from) a layer.
template <class T> struct WeightGradients {
    std::vector<T> w[LAYERS], b[LAYERS];
    explicit WeightGradients(const PackedWeights<T>& weights) {
        for (int l = 0; l < LAYERS; l++) {
            w[l].assign(size_t((weights.sizes[l + 1] + ROWS - 1) / ROWS * ROWS) * weights.padded[l], T(0));
            b[l].assign(weights.padded[l + 1], T(0));
        }
    }
};

// The network on one block of particles: unit[l] holds the activations of layer l, (BLOCK, padded[l]).
template <class T> struct NetworkBlock {
    const PackedWeights<T>& weights;
    std::vector<T> unit[LAYERS + 1], slope[LAYERS + 1], gradient[LAYERS + 1];

    explicit NetworkBlock(const PackedWeights<T>& packed) : weights(packed) {
        for (int l = 0; l <= LAYERS; l++) {
            unit[l].assign(size_t(BLOCK) * packed.padded[l], T(0));
            slope[l] = gradient[l] = unit[l];
        }
    }

    // Component k of L particles of a layer's array (unit, gradient).
    V get(const std::vector<T> (&array)[LAYERS + 1], int layer, int first, int k) const {
        const int stride = weights.padded[layer];
        const T* at = array[layer].data() + size_t(first) * stride + k;
        // from registers: a vector that is loaded from places just written one by one has to wait for them
        typedef T Part __attribute__((vector_size(L * sizeof(T))));
        Part part;
#pragma GCC unroll 8
        for (int l = 0; l < L; l++) part[l] = at[l * stride];
        return __builtin_convertvector(part, V);
    }
    void put(std::vector<T> (&array)[LAYERS + 1], int layer, int first, int k, V values) {
        T* at = array[layer].data() + size_t(first) * weights.padded[layer] + k;
        double lanes[L];
        std::memcpy(lanes, &values, sizeof lanes);
        for (int l = 0; l < L; l++) at[l * weights.padded[layer]] = T(lanes[l]);
    }

    // unit[0] to unit[LAYERS]; SLOPE keeps what backward() and rates() need
    template <bool SLOPE> void forward() {
        for (int l = 0; l < LAYERS; l++) {
            product(BLOCK, weights.padded[l + 1], weights.sizes[l], unit[l].data(), weights.padded[l], 1,
                    weights.forward[l].data(), weights.bias[l].data(), 0, unit[l + 1].data());
            if (l + 1 < LAYERS) gelu<SLOPE>(BLOCK * weights.padded[l + 1], unit[l + 1].data(), slope[l + 1].data());
        }
    }

    // gradient[LAYERS] to gradient[0], adding to the gradients of the weights where they are wanted
    void backward(WeightGradients<T>* wanted) {
        for (int l = LAYERS - 1; l >= 0; l--) {
            const int from = weights.padded[l], to = weights.padded[l + 1];
            if (wanted) {
                const int rows = (weights.sizes[l + 1] + ROWS - 1) / ROWS * ROWS;
                product(rows, from, BLOCK, gradient[l + 1].data(), 1, to, unit[l].data(), wanted->w[l].data(), from,
                        wanted->w[l].data());
                for (int p = 0; p < BLOCK; p++)
                    for (int o = 0; o < to; o++) wanted->b[l][o] += gradient[l + 1][size_t(p) * to + o];
            }
            product(BLOCK, from, weights.sizes[l + 1], gradient[l + 1].data(), to, 1, weights.backward[l].data(),
                    static_cast<const T*>(nullptr), 0, gradient[l].data());
            if (l > 0)
                for (int k = 0; k < BLOCK * from; k++) gradient[l][k] *= slope[l][k];
        }
    }

    // rates of change: gradient[0] to gradient[LAYERS] along the way forward, after forward()
    void rates() {
        for (int l = 0; l < LAYERS; l++) {
            const int to = weights.padded[l + 1];
            product(BLOCK, to, weights.sizes[l], gradient[l].data(), weights.padded[l], 1, weights.forward[l].data(),
                    static_cast<const T*>(nullptr), 0, gradient[l + 1].data());
            if (l + 1 < LAYERS)
                for (int k = 0; k < BLOCK * to; k++) gradient[l + 1][k] *= slope[l + 1][k];
        }
    }
};

}  // namespace pcnclaws
