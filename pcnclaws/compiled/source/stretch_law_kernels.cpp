// The laws of laws/neural_paper.py: a network of the right stretch, on all particles, and its adjoint. F = R U, and with
// the features x of U - I,
//     n = sqrt(unit^2 + own (x_0^2 + x_1^2)),   S = factor n (N(x / n, conditions) - rest),
// the result is the stress R S F^T or the deformation F + R S.
#define LAW_LAYERS 3
#define LAW_ROWS 0
#define LAW_INTERNAL 0
#include "guarded.hpp"
#include "network.hpp"
#include "parallel.hpp"

using namespace pcnclaws;
using T = NUMBER;

namespace {

constexpr int FEATURES = 10, OUTPUTS = 6, GROUPS = BLOCK / L;
constexpr int64_t TASK = 1024;  // particles of one task: the sum over tasks does not depend on the number of threads
constexpr int ROW_OF[OUTPUTS] = {0, 1, 2, 0, 0, 1}, COLUMN_OF[OUTPUTS] = {0, 1, 2, 1, 2, 2};
constexpr int MOST_ITERATIONS = 40;
constexpr double SMALLEST = 1e-12;  // added to |dev|^2 where it divides
const double THIRD = 3.0 * std::sqrt(6.0);

typedef V Matrix[3][3];

struct StretchLaw {
    int64_t particles;
    const T* deformation;  // (9, particles)
    const T* rows;         // conditions, rest (OUTPUTS), unit, factor: (conditions + OUTPUTS + 2, particles)
    int conditions;
    int returns_strain;
    double own;  // 1, or 0 for strain in constant units
    const Weights<T>* weights;
};

void cofactors(const Matrix a, Matrix c) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int p = (i + 1) % 3, q = (i + 2) % 3, r = (j + 1) % 3, s = (j + 2) % 3;
            c[i][j] = a[p][r] * a[q][s] - a[p][s] * a[q][r];
        }
}
V determinant(const Matrix a, const Matrix cofactor) {
    return a[0][0] * cofactor[0][0] + a[0][1] * cofactor[0][1] + a[0][2] * cofactor[0][2];
}
V sum_of_squares(const Matrix a) {
    V sum{};
    for (int k = 0; k < 9; k++) sum += a[k / 3][k % 3] * a[k / 3][k % 3];
    return sum;
}
// c = a b, a^T b or a b^T
template <bool FIRST, bool SECOND> void product3(const Matrix a, const Matrix b, Matrix c) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            V sum{};
            for (int k = 0; k < 3; k++) sum += (FIRST ? a[k][i] : a[i][k]) * (SECOND ? b[j][k] : b[k][j]);
            c[i][j] = sum;
        }
}

// The rotation of F by Newton's method, scaled (Higham 1986, "Computing the polar decomposition").
void rotation_of(const Matrix f, Matrix r) {
    for (int k = 0; k < 9; k++) r[k / 3][k % 3] = f[k / 3][k % 3];
    for (int iteration = 0; iteration < MOST_ITERATIONS; iteration++) {
        Matrix inverse;  // transposed
        cofactors(r, inverse);
        const V inverse_determinant = 1.0 / determinant(r, inverse);
        for (int k = 0; k < 9; k++) inverse[k / 3][k % 3] *= inverse_determinant;
        const V scale = square_root(square_root(sum_of_squares(inverse) / sum_of_squares(r)));
        const V one = 0.5 * scale, other = 0.5 / scale;
        V change{};
        for (int k = 0; k < 9; k++) {
            const V next = one * r[k / 3][k % 3] + other * inverse[k / 3][k % 3];
            change += absolute(next - r[k / 3][k % 3]);
            r[k / 3][k % 3] = next;
        }
        if (!any(change > 1e-8)) return;  // the next change would be its square
    }
}

// One block of up to BLOCK particles.
struct StretchBlock {
    const StretchLaw& in;
    NetworkBlock<T>& network;
    int64_t begin = 0, end = 0;
    struct Group {
        Matrix f, r, u, deviator, cofactor, s;
        V x[FEATURES], y[OUTPUTS], size, determinant, scale, unit, factor;
    } group[GROUPS];

    int groups() const { return int((end - begin + L - 1) / L); }
    V row(int g, int k) const { return load(in.rows + k * in.particles, begin + g * L, end); }

    template <bool SLOPE> void enter(int64_t first, int64_t last) {
        begin = first;
        end = last;
        for (int g = 0; g < groups(); g++) {
            Group& at = group[g];
            for (int k = 0; k < 9; k++)
                at.f[k / 3][k % 3] = load(in.deformation + k * in.particles, begin + g * L, end);
            rotation_of(at.f, at.r);
            Matrix half;
            product3<true, false>(at.r, at.f, half);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) at.u[i][j] = 0.5 * (half[i][j] + half[j][i]);
            put_features(at);
            at.unit = row(g, in.conditions + OUTPUTS);
            at.factor = row(g, in.conditions + OUTPUTS + 1);
            at.scale = square_root(at.unit * at.unit + in.own * (at.x[0] * at.x[0] + at.x[1] * at.x[1]));
            const V inverse = 1.0 / at.scale;
            for (int k = 0; k < FEATURES; k++) network.put(network.unit, 0, g * L, k, at.x[k] * inverse);
            for (int k = 0; k < in.conditions; k++) network.put(network.unit, 0, g * L, FEATURES + k, row(g, k));
        }
        network.template forward<SLOPE>();
        for (int g = 0; g < groups(); g++) {
            Group& at = group[g];
            for (int k = 0; k < OUTPUTS; k++) {
                at.y[k] = network.get(network.unit, LAYERS, g * L, k) - row(g, in.conditions + k);
                at.s[ROW_OF[k]][COLUMN_OF[k]] = at.s[COLUMN_OF[k]][ROW_OF[k]] = at.factor * at.scale * at.y[k];
            }
        }
    }
    void put_features(Group& at) {
        const V mean = (at.u[0][0] + at.u[1][1] + at.u[2][2] - 3.0) / 3.0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) at.deviator[i][j] = i == j ? at.u[i][j] - 1.0 - mean : at.u[i][j];
        at.size = square_root(sum_of_squares(at.deviator));
        Matrix of_deviator;
        cofactors(at.deviator, of_deviator);
        at.determinant = determinant(at.deviator, of_deviator);
        cofactors(at.u, at.cofactor);
        at.x[0] = 3.0 * mean;
        at.x[1] = at.size;
        at.x[2] = THIRD * at.determinant / (at.size * at.size + SMALLEST);
        at.x[3] = determinant(at.u, at.cofactor) - 1.0;
        for (int k = 0; k < OUTPUTS; k++)
            at.x[4 + k] = at.u[ROW_OF[k]][COLUMN_OF[k]] - (k < 3 ? 1.0 : 0.0);
    }

    void leave(int g, T* result) const {
        const Group& at = group[g];
        Matrix half, out;
        product3<false, false>(at.r, at.s, half);
        if (!in.returns_strain) product3<false, true>(half, at.f, out);
        for (int k = 0; k < 9; k++) {
            const V value = in.returns_strain ? at.f[k / 3][k % 3] + half[k / 3][k % 3] : out[k / 3][k % 3];
            store(result + k * in.particles, begin + g * L, end, value);
        }
    }

    struct Adjoint {
        Matrix f, r;  // gradients of F, but for the way through R and U, and of R
        V scale;
    };
    void first(int g, const T* incoming, Adjoint& a, T* rows_gradient) {
        const Group& at = group[g];
        Matrix t, of_s, half;
        for (int k = 0; k < 9; k++) t[k / 3][k % 3] = load(incoming + k * in.particles, begin + g * L, end);
        if (in.returns_strain) {
            product3<true, false>(at.r, t, of_s);
            product3<false, false>(t, at.s, a.r);
            for (int k = 0; k < 9; k++) a.f[k / 3][k % 3] = t[k / 3][k % 3];
        } else {
            product3<true, false>(at.r, t, half);
            product3<false, false>(half, at.f, of_s);
            product3<false, false>(t, at.f, half);
            product3<false, false>(half, at.s, a.r);
            product3<false, false>(at.r, at.s, half);
            product3<true, false>(t, half, a.f);
        }
        V of_factor{};
        const int64_t inside = end - begin - g * L;  // a particle repeated beyond the end counts once
        for (int k = 0; k < OUTPUTS; k++) {
            const int i = ROW_OF[k], j = COLUMN_OF[k];
            const V slope = i == j ? of_s[i][j] : of_s[i][j] + of_s[j][i];
            V of_output = slope * at.scale * at.factor;
            of_factor += slope * at.y[k];
            write_row(rows_gradient, in.conditions + k, g, -of_output);
            for (int l = 0; l < L; l++)
                if (l >= inside) set_lane(of_output, l, 0.0);
            network.put(network.gradient, LAYERS, g * L, k, of_output);
        }
        a.scale = of_factor * at.factor;
        write_row(rows_gradient, in.conditions + OUTPUTS + 1, g, of_factor * at.scale);
    }
    void second(int g, Adjoint& a, T* gradient, T* rows_gradient) {
        const Group& at = group[g];
        const V inverse = 1.0 / at.scale;
        V x[FEATURES];
        for (int k = 0; k < FEATURES; k++) {
            x[k] = network.get(network.gradient, 0, g * L, k) * inverse;
            a.scale -= x[k] * at.x[k] * inverse;
        }
        for (int k = 0; k < in.conditions; k++)
            write_row(rows_gradient, k, g, network.get(network.gradient, 0, g * L, FEATURES + k));
        write_row(rows_gradient, in.conditions + OUTPUTS, g, a.scale * at.unit * inverse);
        for (int k = 0; k < 2; k++) x[k] += in.own * a.scale * at.x[k] * inverse;

        Matrix of_u, of_deviator;
        const V squared = at.size * at.size + SMALLEST;
        const V along = select(at.size > 0.0, x[1] / select(at.size > 0.0, at.size, splat(1.0)), V{}) -
                        2.0 * THIRD * x[2] * at.determinant / (squared * squared);
        cofactors(at.deviator, of_deviator);
        V trace{};
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                of_u[i][j] = along * at.deviator[i][j] + THIRD * x[2] / squared * of_deviator[i][j];
                if (i == j) trace += of_u[i][j];
            }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                of_u[i][j] += x[3] * at.cofactor[i][j];
                if (i == j) of_u[i][j] += x[0] - trace / 3.0;
            }
        for (int k = 0; k < 3; k++) of_u[k][k] += x[4 + k];
        for (int k = 3; k < OUTPUTS; k++) {
            of_u[ROW_OF[k]][COLUMN_OF[k]] += 0.5 * x[4 + k];
            of_u[COLUMN_OF[k]][ROW_OF[k]] += 0.5 * x[4 + k];
        }

        // through R and U, laws/rotation.py
        Matrix turning, half, system, inverted, out;
        product3<true, false>(at.r, a.r, turning);
        product3<false, false>(of_u, at.u, half);
        const V whole = at.u[0][0] + at.u[1][1] + at.u[2][2];
        V axis[3];
        for (int i = 0; i < 3; i++) {
            const int p = (i + 1) % 3, q = (i + 2) % 3;
            axis[i] = (turning[q][p] - half[q][p]) - (turning[p][q] - half[p][q]);
            for (int j = 0; j < 3; j++) system[i][j] = i == j ? whole - at.u[i][j] : -at.u[i][j];
        }
        cofactors(system, inverted);
        const V inverse_determinant = 1.0 / determinant(system, inverted);
        for (int i = 0; i < 3; i++) {
            const int p = (i + 1) % 3, q = (i + 2) % 3;
            const V w = (inverted[i][0] * axis[0] + inverted[i][1] * axis[1] + inverted[i][2] * axis[2]) * inverse_determinant;
            of_u[q][p] += w;
            of_u[p][q] -= w;
        }
        product3<false, false>(at.r, of_u, out);
        for (int k = 0; k < 9; k++)
            store(gradient + k * in.particles, begin + g * L, end, out[k / 3][k % 3] + a.f[k / 3][k % 3]);
    }
    void write_row(T* rows_gradient, int k, int g, V values) const {
        if (rows_gradient) store(rows_gradient + k * in.particles, begin + g * L, end, values);
    }
};

bool fits(const StretchLaw& in) {
    return in.weights->sizes[0] == FEATURES + in.conditions && in.weights->sizes[LAYERS] == OUTPUTS;
}

int64_t task_count(int64_t particles) { return (particles + TASK - 1) / TASK; }

template <bool SLOPE, class Visit> void for_each_block(const StretchLaw& in, int threads, Visit visit) {
    const PackedWeights<T> packed(*in.weights, SLOPE);
    parallel_for(task_count(in.particles), threads, [&](int64_t task) {
        NetworkBlock<T> network(packed);
        StretchBlock block{in, network};
        const int64_t last = std::min(in.particles, (task + 1) * TASK);
        for (int64_t first = task * TASK; first < last; first += BLOCK) {
            block.template enter<SLOPE>(first, std::min(first + BLOCK, last));
            visit(block, task);
        }
    });
}

}  // namespace

KERNEL(stretch_law_forward)(const StretchLaw* in, T* result, int threads) {
    return guarded([&] {
        if (!fits(*in)) return false;
        for_each_block<false>(*in, threads, [&](StretchBlock& block, int64_t) {
            for (int g = 0; g < block.groups(); g++) block.leave(g, result);
        });
        return true;
    });
}

// gradients of F, of the rows and of the weights, as PyTorch keeps them; the last two null where not wanted
KERNEL(stretch_law_adjoint)
(const StretchLaw* in, const T* incoming, T* gradient, T* rows_gradient, T* const* weight_gradients, int threads) {
    return guarded([&] {
        if (!fits(*in)) return false;
        std::vector<WeightGradients<T>> sums;
        if (weight_gradients)
            for (int64_t task = 0; task < task_count(in->particles); task++) sums.emplace_back(*in->weights);
        for_each_block<true>(*in, threads, [&](StretchBlock& block, int64_t task) {
            StretchBlock::Adjoint adjoint[GROUPS];
            auto& outgoing = block.network.gradient[LAYERS];
            std::fill(outgoing.begin(), outgoing.end(), T(0));
            for (int g = 0; g < block.groups(); g++) block.first(g, incoming, adjoint[g], rows_gradient);
            block.network.backward(weight_gradients ? &sums[size_t(task)] : nullptr);
            for (int g = 0; g < block.groups(); g++) block.second(g, adjoint[g], gradient, rows_gradient);
        });
        for (int l = 0; weight_gradients && l < LAYERS; l++) {
            const int from = in->weights->sizes[l], to = in->weights->sizes[l + 1], stride = padded_size<T>(from);
            for (int o = 0; o < to; o++) {
                T bias = 0;
                for (const auto& sum : sums) bias += sum.b[l][size_t(o)];
                weight_gradients[LAYERS + l][o] = bias;
                for (int i = 0; i < from; i++) {
                    T total = 0;
                    for (const auto& sum : sums) total += sum.w[l][size_t(o) * stride + i];
                    weight_gradients[l][size_t(o) * from + i] = total;
                }
            }
        }
        return true;
    });
}
