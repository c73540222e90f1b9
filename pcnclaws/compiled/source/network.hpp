// A multilayer perceptron with two hidden layers and GELU, block of particles by block, so that the activations stay in
// the cache. Particle-major: the units of a layer are the lanes.
#pragma once
#include <vector>

#include "law_input.hpp"

namespace pcnclaws {

constexpr int BLOCK = 32;  // particles

template <class T> Vector<T> load_vector(const T* from) {
    Vector<T> out;
    std::memcpy(&out, from, sizeof out);
    return out;
}
template <class T> void store_vector(T* to, Vector<T> values) { std::memcpy(to, &values, sizeof values); }

// Keeps a value that is used several times in its register: compilers on x86 would rather read it from memory at every
// use, as a part of the instruction, which is more reading than a core has time for.
template <class U> void keep_in_register(U& value) {
#if defined(__x86_64__)
    asm("" : "+v"(value));
#else
    (void)value;
#endif
}

// y[r][:] = start[r][:] + sum_k x[r][k] w[k][:] for ROWS rows and COLUMNS vectors of columns, in registers. x is read
// with the strides (row, step), so that it may be a transpose. On its own: as a part of a large function it would not
// find enough registers.
template <class T, int ROWS, int COLUMNS>
__attribute__((noinline)) void product_tile(const T* x, int row, int step, const T* w, int w_row, int count,
                                            const T* start, int start_row, T* y, int y_row) {
    Vector<T> sum[ROWS][COLUMNS];
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; r++)
#pragma GCC unroll 2
        for (int c = 0; c < COLUMNS; c++)
            sum[r][c] = start ? load_vector(start + r * start_row + c * LANES<T>) : Vector<T>{};
    for (int k = 0; k < count; k++) {
        Vector<T> wk[COLUMNS];
#pragma GCC unroll 2
        for (int c = 0; c < COLUMNS; c++) {
            wk[c] = load_vector(w + k * w_row + c * LANES<T>);
            keep_in_register(wk[c]);
        }
#pragma GCC unroll 8
        for (int r = 0; r < ROWS; r++) {
            const T xk = x[r * row + k * step];
#pragma GCC unroll 2
            for (int c = 0; c < COLUMNS; c++) sum[r][c] += xk * wk[c];
        }
    }
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; r++)
#pragma GCC unroll 2
        for (int c = 0; c < COLUMNS; c++) store_vector(y + r * y_row + c * LANES<T>, sum[r][c]);
}

// The whole product: `rows` a multiple of ROWS, `columns` a multiple of the lanes.
constexpr int ROWS = 8;
// Sizes of layers are rounded up to whole vectors and whole tiles.
template <class T> constexpr int padded_size(int size) {
    constexpr int unit = LANES<T> > ROWS ? LANES<T> : ROWS;
    return (size + unit - 1) / unit * unit;
}
constexpr int WIDE_ROWS = BYTES == 64 ? 8 : 4;  // the sums stay in registers: 32 of 64 bytes, or 16 narrower ones
template <class T>
void product(int rows, int columns, int count, const T* x, int row, int step, const T* w, const T* start, int start_row,
             T* y) {
    int c = 0;
    for (; c + 2 * LANES<T> <= columns; c += 2 * LANES<T>)
        for (int r = 0; r < rows; r += WIDE_ROWS)
            product_tile<T, WIDE_ROWS, 2>(x + r * row, row, step, w + c, columns, count,
                                          start ? start + r * start_row + c : nullptr, start_row, y + r * columns + c,
                                          columns);
    for (; c < columns; c += LANES<T>)
        for (int r = 0; r < rows; r += ROWS)
            product_tile<T, ROWS, 1>(x + r * row, row, step, w + c, columns, count,
                                     start ? start + r * start_row + c : nullptr, start_row, y + r * columns + c,
                                     columns);
}

// GELU x Phi(x) and its derivative Phi(x) + x phi(x), with the normal distribution Phi and its density phi. In single
// precision Phi is 1/2 plus x times a polynomial in x^2 fitted on |x| < 5.4, beyond which it is 0 or 1. GELU is right to
// 2e-7, its derivative to 3e-7.
constexpr float GELU_RANGE = 5.4f;
constexpr float CDF[] = {0.000376044092f, -0.00102007787f, 0.000929660053f, -0.00121130003f, 0.00358935175f,
                         -0.00668679878f, 0.00969475472f,  -0.0139788988f,  0.0196312566f,   -0.0257423645f,
                         0.0321186832f,   -0.0392072682f,  0.0484994752f,   -0.0653280406f,  0.130928114f};
// 2^r/sqrt(2 pi) on |r| < 1/2
constexpr float DENSITY[] = {0.000529653684f, 0.00385998306f, 0.0221441425f, 0.0958343893f, 0.276525646f, 0.398942322f};

// A polynomial, highest power first. Four shorter sums run side by side: one long sum would leave the processor waiting
// for its last term.
template <int COUNT> Vector<float> polynomial(const float (&fitted)[COUNT], Vector<float> t) {
    const Vector<float> t2 = t * t, t4 = t2 * t2;
    Vector<float> sum[4];
#pragma GCC unroll 4
    for (int k = 0; k < 4; k++) {
        const int last = COUNT - 1 - k, first = last % 4;  // of the powers k, k + 4, k + 8 ...
        sum[k] = Vector<float>{} + fitted[first];
#pragma GCC unroll 8
        for (int m = first + 4; m <= last; m += 4) sum[k] = sum[k] * t4 + fitted[m];
    }
    return (sum[3] * t + sum[2]) * t2 + (sum[1] * t + sum[0]);
}
// phi(x) from x^2; that of |x| = 12 beyond
inline Vector<float> normal_density(Vector<float> squared) {
    typedef int32_t Bits __attribute__((vector_size(BYTES)));
    const Vector<float> least = Vector<float>{} - 103.87404f, shift = Vector<float>{} + 12582912.0f;  // 3 * 2^22
    Vector<float> exponent = squared * -0.72134752f;  // of 2
    exponent = exponent > least ? exponent : least;
    const Vector<float> rounded = exponent + shift, part = polynomial(DENSITY, exponent - (rounded - shift));
    Bits power, bits;
    std::memcpy(&power, &rounded, sizeof power);
    std::memcpy(&bits, &part, sizeof bits);
    bits += power << 23;  // times 2^n, n in the lowest bits of what was rounded
    Vector<float> density;
    std::memcpy(&density, &bits, sizeof density);
    return density;
}
inline Vector<float> gelu(Vector<float> x) {
    const Vector<float> range = Vector<float>{} + GELU_RANGE;
    Vector<float> inside = x < range ? x : range;
    inside = inside > -range ? inside : -range;
    const Vector<float> t = inside * inside * (2.0f / (GELU_RANGE * GELU_RANGE)) - 1.0f;
    return x * (0.5f + inside * polynomial(CDF, t));
}
// Beside the density, which the slope needs, Phi takes less time: beyond x > 0 there is phi(x) (b_1 t + ... + b_5 t^5) of
// it, t = 1/(1 + 0.2316419 x), to 8e-8 (Hastings 1955, "Approximations for digital computers").
inline Vector<float> gelu(Vector<float> x, Vector<float>& slope) {
    const Vector<float> density = normal_density(x * x), t = 1.0f / (1.0f + 0.2316419f * (x < 0.0f ? -x : x)), t2 = t * t;
    const Vector<float> upper = 1.330274429f * t - 1.821255978f, lower = 1.781477937f * t - 0.356563782f;
    const Vector<float> beyond = density * ((upper * t2 + lower) * t2 + 0.319381530f * t);
    const Vector<float> below = x < 0.0f ? beyond : 1.0f - beyond;
    slope = below + x * density;
    return x * below;
}
inline Vector<double> normal_cdf(Vector<double> x) {
    Vector<double> below;
    for (int l = 0; l < LANES<double>; l++) below[l] = 0.5 * std::erfc(-0.7071067811865476 * x[l]);
    return below;
}
inline Vector<double> gelu(Vector<double> x) { return x * normal_cdf(x); }
inline Vector<double> gelu(Vector<double> x, Vector<double>& slope) {
    const Vector<double> below = normal_cdf(x);
    slope = below + x * exponential(-0.5 * x * x) * 0.3989422804014327;
    return x * below;
}

// GELU of an array in place, and its derivative where it is wanted.
template <bool SLOPE, class T> void gelu(int count, T* x, T* slope) {
    for (int k = 0; k < count; k += LANES<T>) {
        const Vector<T> before = load_vector(x + k);
        if constexpr (SLOPE) {
            Vector<T> rate;
            store_vector(x + k, gelu(before, rate));
            store_vector(slope + k, rate);
        } else {
            store_vector(x + k, gelu(before));
        }
    }
}

// An array times another, in place.
template <class T> void multiply(int count, T* x, const T* factor) {
    for (int k = 0; k < count; k += LANES<T>) store_vector(x + k, load_vector(x + k) * load_vector(factor + k));
}

// The weights padded to whole vectors, in the orders of the passes forward and backward.
template <class T> struct PackedWeights {
    int sizes[LAYERS + 1], padded[LAYERS + 1];
    std::vector<T> forward[LAYERS], backward[LAYERS], bias[LAYERS];

    // both: in the order of the pass backward, too
    PackedWeights(const Weights<T>& weights, bool both) {
        for (int l = 0; l <= LAYERS; l++) {
            sizes[l] = weights.sizes[l];
            padded[l] = padded_size<T>(sizes[l]);
        }
        for (int l = 0; l < LAYERS; l++) {
            const int from = sizes[l], to = sizes[l + 1];
            forward[l].assign(size_t(from) * padded[l + 1], T(0));
            if (both) backward[l].assign(size_t(to) * padded[l], T(0));
            bias[l].assign(padded[l + 1], T(0));
            for (int o = 0; o < to; o++) {
                bias[l][o] = weights.b[l][o];
                const T* row = weights.w[l] + size_t(o) * from;
                for (int i = 0; i < from; i++) forward[l][size_t(i) * padded[l + 1] + o] = row[i];
                if (both) std::copy(row, row + from, backward[l].begin() + size_t(o) * padded[l]);
            }
        }
    }
};

// Gradients of the weights, (padded to, padded from) a layer.
template <class T> struct WeightGradients {
    std::vector<T> w[LAYERS], b[LAYERS];
    explicit WeightGradients(const Weights<T>& weights) {
        for (int l = 0; l < LAYERS; l++) {
            const int from = padded_size<T>(weights.sizes[l]), to = padded_size<T>(weights.sizes[l + 1]);
            w[l].assign(size_t(to) * from, T(0));
            b[l].assign(to, T(0));
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
                product(to, from, BLOCK, gradient[l + 1].data(), 1, to, unit[l].data(), wanted->w[l].data(), from,
                        wanted->w[l].data());
                for (int o = 0; o < to; o += LANES<T>) {
                    Vector<T> sum = load_vector(wanted->b[l].data() + o);
                    for (int p = 0; p < BLOCK; p++) sum += load_vector(gradient[l + 1].data() + p * to + o);
                    store_vector(wanted->b[l].data() + o, sum);
                }
            }
            product(BLOCK, from, weights.sizes[l + 1], gradient[l + 1].data(), to, 1, weights.backward[l].data(),
                    static_cast<const T*>(nullptr), 0, gradient[l].data());
            if (l > 0) multiply(BLOCK * from, gradient[l].data(), slope[l].data());
        }
    }

    // rates of change: gradient[0] to gradient[LAYERS] along the way forward, after forward()
    void rates() {
        for (int l = 0; l < LAYERS; l++) {
            const int to = weights.padded[l + 1];
            product(BLOCK, to, weights.sizes[l], gradient[l].data(), weights.padded[l], 1, weights.forward[l].data(),
                    static_cast<const T*>(nullptr), 0, gradient[l + 1].data());
            if (l + 1 < LAYERS) multiply(BLOCK * to, gradient[l + 1].data(), slope[l + 1].data());
        }
    }
};

}  // namespace pcnclaws
