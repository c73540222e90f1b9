// Some particles on their way through a law: the map, its adjoint and its directional derivative, from the few lines in
// principal space.
//
// With b = F F^T = Q diag(b) Q^T a law is Y(b) = Q diag(y) Q^T. Its derivative in principal axes is that of y on the
// diagonal and a divided difference of y off it.
#pragma once
#include "law.hpp"
#include "law_input.hpp"
#include "spectral.hpp"

namespace pcnclaws {

#ifdef ONE_LANE
constexpr int GROUPS = 1;
#else
constexpr int GROUPS = 32 / L;
#endif
constexpr int TOGETHER = GROUPS < 4 ? GROUPS : 4;  // groups whose principal axes are found in step

// Network: gets the features and parameters, gives the outputs (network.hpp, thread_network.hpp).
// One block of up to BLOCK particles on its way through a law.
template <class T, class Law, class Network> struct LawBlock {
    static constexpr bool NETWORK = Law::FEATURES > 0;
    // what a response depends on: strains, features, parameters, outputs of the network, internal variables
    static constexpr int FEATURES = 3, PARAMETERS = FEATURES + Law::FEATURES, OUTPUTS = PARAMETERS + Law::PARAMETERS,
                         REMEMBERED = OUTPUTS + Law::OUTPUTS, INPUTS = REMEMBERED + INTERNAL;
    // what it gives: three principal values, then internal variables
    static constexpr int AFTER = Law::RETURN_MAP ? INTERNAL : 0, VALUES = 3 + AFTER;

    const LawInput<T>& in;
    Network* network;
    int64_t begin = 0, end = 0;
    V f[GROUPS][3][3] = {};
    Principal principal[GROUPS];
    V p[GROUPS][PARAMETER_ROWS + 1];
    V x[GROUPS][Law::FEATURES + 1];
    V q[GROUPS][INTERNAL + 1];

    LawBlock(const LawInput<T>& input, Network* block) : in(input), network(block) {}

    int groups() const { return int((end - begin + L - 1) / L); }

    // loads the particles, finds their principal axes and runs the network
    template <bool SLOPE> void enter(int64_t first, int64_t last) {
        begin = first;
        end = last;
        for (int group = 0; group < groups(); group++) {
            const int64_t at = begin + group * L;
            for (int k = 0; k < 9; k++) f[group][k / 3][k % 3] = load(in.deformation + k * in.particles, at, end);
            for (int k = 0; k < PARAMETER_ROWS; k++) p[group][k] = load(in.parameters + k * in.particles, at, end);
            for (int k = 0; k < INTERNAL; k++) q[group][k] = load(in.internal + k * in.particles, at, end);
        }
        Mask left[GROUPS];
        for (int group = 0; group < groups(); group += TOGETHER)
            principal_axes<T, TOGETHER>(f + group, principal + group, left + group);
        for (int group = 0; group < groups(); group++)
            if (any(left[group])) find_graded_axes(f[group], left[group], end - begin - group * L, principal[group]);
        if constexpr (NETWORK) {
            for (int group = 0; group < groups(); group++) {
                Law::features(principal[group].strain, x[group]);
                for (int k = 0; k < Law::FEATURES; k++) network->put(network->unit, 0, group * L, k, x[group][k]);
                for (int k = Law::PARAMETERS; k < PARAMETER_ROWS; k++)
                    network->put(network->unit, 0, group * L, k - Law::PARAMETERS + Law::FEATURES, p[group][k]);
            }
            network->template forward<SLOPE>();
        }
    }

    // what the response depends on, by number
    V value_at(int group, int k) {
        if (k < FEATURES) return principal[group].strain[k];
        if (k < PARAMETERS) return x[group][k - FEATURES];
        if (k < OUTPUTS) return p[group][k - PARAMETERS];
        if (k >= REMEMBERED) return q[group][k - REMEMBERED];
        return network->get(network->unit, LAYERS, group * L, k - OUTPUTS);
    }
    // values y, of plain values or of values that make(k) differentiates
    template <class S, class Make> void respond(S y[VALUES], Make make) {
        S in[INPUTS + 1];
        for (int k = 0; k < INPUTS; k++) in[k] = make(k);
        Law::respond(in, in + FEATURES, in + PARAMETERS, in + OUTPUTS, in + REMEMBERED, y);
    }
    void respond(int group, V y[VALUES]) {
        respond(y, [&](int k) { return value_at(group, k); });
    }

    // stress Q diag(y) Q^T, or F' = F + Q diag(e^y - 1) Q^T F, which is F to the last bit where y is 0. Large changes
    // would cancel: F' = Q diag(e^y) Q^T F.
    void leave(int group, const V y[VALUES], const LawFields<T>& result) const {
        const Principal& axes = principal[group];
        V stretch[3], kept = V{};
        if constexpr (Law::RETURN_MAP)
            kept = select(maximum(absolute(y[0]), maximum(absolute(y[1]), absolute(y[2]))) < 1.0, splat(1.0), V{});
        for (int k = 0; k < 3; k++) stretch[k] = Law::RETURN_MAP ? exponential(y[k]) - kept : y[k];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                V sum = Law::RETURN_MAP ? kept * f[group][i][j] : V{};
                for (int k = 0; k < 3; k++)
                    sum += axes.q[i][k] * stretch[k] * (Law::RETURN_MAP ? axes.g[k][j] : axes.q[j][k]);
                store(result.matrix + (3 * i + j) * in.particles, begin + group * L, end, sum);
            }
        for (int k = 0; k < AFTER; k++) store(result.internal + k * in.particles, begin + group * L, end, y[3 + k]);
    }

    // eigenvalues of what multiplies: y, or e^y for a return map
    static void eigenvalues(const V y[3], V value[3]) {
        for (int i = 0; i < 3; i++) value[i] = Law::RETURN_MAP ? exponential(y[i]) : y[i];
    }
    void differences(int group, const V value[3], V off[3][3]) {
        divided_differences(
            principal[group], value,
            [&](V slope[3][3]) {
                Dual<3> y[VALUES];
                // at fixed features: what they add to one strain's slope, they add to the other's where the two meet
                respond(y, [&](int k) {
                    Dual<3> in = constant(value_at(group, k), Dual<3>{});
                    if (k < FEATURES) in.rate[k] = splat(1.0);
                    return in;
                });
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++) slope[i][j] = Law::RETURN_MAP ? value[i] * y[i].rate[j] : y[i].rate[j];
            },
            off);
    }

    // Adjoint: first(group) writes the gradients at the network's outputs, then network->backward(), then
    // second(group).
    struct Adjoint {
        V wanted[3][3];          // gradient of the eigenvalue matrix in principal axes, symmetric
        V strain[3];             // gradient of the principal strains
        V x[Law::FEATURES + 1];  // gradient of the features, but for the way through the network
        V off[3][3];             // divided differences
        V multiplied[3][3];      // M^T times the incoming gradient, for a return map
    };
    // all in one function, so that the tape needs no calls
    IN_ONE_FUNCTION void adjoint_first(int group, const LawFields<const T>& incoming, Adjoint& a, T* internal_gradient,
                                       T* parameter_gradient) {
        const Principal& axes = principal[group];
        V g[3][3], y_bar[3][3], y[3], value[3];
        for (int k = 0; k < 9; k++) g[k / 3][k % 3] = load(incoming.matrix + k * in.particles, begin + group * L, end);
        TapeEntries entries;
        Tape tape(entries);
        Taped y_tape[VALUES];
        respond(y_tape, [&](int k) { return variable(value_at(group, k), tape); });
        for (int k = 0; k < 3; k++) y[k] = y_tape[k].value;
        eigenvalues(y, value);
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) {
                V sum{};
                for (int j = 0; j < 3; j++) sum += g[i][j] * (Law::RETURN_MAP ? axes.g[k][j] : axes.q[j][k]);
                y_bar[i][k] = sum;
            }
        V principal_bar[3][3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                principal_bar[i][k] =
                    axes.q[0][i] * y_bar[0][k] + axes.q[1][i] * y_bar[1][k] + axes.q[2][i] * y_bar[2][k];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) a.wanted[i][j] = 0.5 * (principal_bar[i][j] + principal_bar[j][i]);
        differences(group, value, a.off);
        // a constant has no entry
        for (int i = 0; i < 3; i++)
            if (y_tape[i].entry >= 0)
                entries.gradient[y_tape[i].entry] += a.wanted[i][i] * (Law::RETURN_MAP ? value[i] : splat(1.0));
        for (int k = 0; k < AFTER; k++)
            if (y_tape[3 + k].entry >= 0)
                entries.gradient[y_tape[3 + k].entry] += load(incoming.internal + k * in.particles, begin + group * L, end);
        tape.sweep();
        const V* total = entries.gradient;  // the inputs are its first entries
        for (int i = 0; i < 3; i++) a.strain[i] = total[i];
        for (int k = 0; k < Law::FEATURES; k++) a.x[k] = total[FEATURES + k];
        if (parameter_gradient)
            for (int k = 0; k < Law::PARAMETERS; k++)
                store(parameter_gradient + k * in.particles, begin + group * L, end, total[PARAMETERS + k]);
        if (internal_gradient)
            for (int k = 0; k < INTERNAL; k++)
                store(internal_gradient + k * in.particles, begin + group * L, end, total[REMEMBERED + k]);
        for (int k = 0; k < Law::OUTPUTS; k++)
            network->put(network->gradient, LAYERS, group * L, k, total[OUTPUTS + k]);
        if constexpr (Law::RETURN_MAP) {
            // M g = Q diag(value) Q^T g
            V turned[3][3];
            for (int k = 0; k < 3; k++)
                for (int j = 0; j < 3; j++)
                    turned[k][j] =
                        value[k] * (axes.q[0][k] * g[0][j] + axes.q[1][k] * g[1][j] + axes.q[2][k] * g[2][j]);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    a.multiplied[i][j] =
                        axes.q[i][0] * turned[0][j] + axes.q[i][1] * turned[1][j] + axes.q[i][2] * turned[2][j];
        }
    }
    void adjoint_second(int group, Adjoint& a, T* gradient, T* parameter_gradient) {
        const Principal& axes = principal[group];
        if constexpr (NETWORK) {
            TapeEntries entries;
            Tape tape(entries);
            Taped h[3], features[Law::FEATURES];
            for (int k = 0; k < 3; k++) h[k] = variable(axes.strain[k], tape);
            Law::features(h, features);
            for (int k = 0; k < Law::FEATURES; k++)
                entries.gradient[features[k].entry] += a.x[k] + network->get(network->gradient, 0, group * L, k);
            tape.sweep();
            for (int i = 0; i < 3; i++) a.strain[i] += entries.gradient[i];
            if (parameter_gradient)
                for (int k = Law::PARAMETERS; k < PARAMETER_ROWS; k++)
                    store(parameter_gradient + k * in.particles, begin + group * L, end,
                          network->get(network->gradient, 0, group * L, k - Law::PARAMETERS + Law::FEATURES));
        }
        // gradient of b in principal axes, then 2 b_bar F = 2 Q (..) G
        V turned[3][3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                turned[i][j] = V{};
                for (int k = 0; k < 3; k++)
                    turned[i][j] +=
                        (i == k ? a.strain[i] / axes.square[i] : 2.0 * a.wanted[i][k] * a.off[i][k]) * axes.g[k][j];
            }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                V sum = Law::RETURN_MAP ? a.multiplied[i][j] : V{};
                for (int k = 0; k < 3; k++) sum += axes.q[i][k] * turned[k][j];
                store(gradient + (3 * i + j) * in.particles, begin + group * L, end, sum);
            }
    }

    // Directional derivative: first(group) writes the rates at the network's inputs, then network->rates(), then
    // second.
    struct Rates {
        V b[3][3];  // rate of b in principal axes
        V strain[3];
        V x[Law::FEATURES + 1];
        V f[3][3];  // rate of F
    };
    void rates_first(int group, const T* deformation_rate, const T* parameter_rate, Rates& r) {
        const Principal& axes = principal[group];
        const int64_t at = begin + group * L;
        for (int k = 0; k < 9; k++) r.f[k / 3][k % 3] = load(deformation_rate + k * in.particles, at, end);
        V turned[3][3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                turned[i][j] = axes.q[0][i] * r.f[0][j] + axes.q[1][i] * r.f[1][j] + axes.q[2][i] * r.f[2][j];
        V half[3][3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                half[i][j] = turned[i][0] * axes.g[j][0] + turned[i][1] * axes.g[j][1] + turned[i][2] * axes.g[j][2];
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) r.b[i][j] = half[i][j] + half[j][i];
            r.strain[i] = 0.5 * r.b[i][i] / axes.square[i];
        }
        if constexpr (NETWORK) {
            Dual<1> h[3], features[Law::FEATURES];
            for (int k = 0; k < 3; k++) h[k] = {axes.strain[k], {r.strain[k]}};
            Law::features(h, features);
            for (int k = 0; k < Law::FEATURES; k++) {
                r.x[k] = features[k].rate[0];
                network->put(network->gradient, 0, group * L, k, r.x[k]);
            }
            for (int k = Law::PARAMETERS; k < PARAMETER_ROWS; k++)
                network->put(network->gradient, 0, group * L, k - Law::PARAMETERS + Law::FEATURES,
                             load(parameter_rate + k * in.particles, at, end));
        }
    }
    void rates_second(int group, const T* parameter_rate, const T* internal_rate, const Rates& r,
                      const LawFields<T>& result, const LawFields<T>& result_rate) {
        const Principal& axes = principal[group];
        const int64_t at = begin + group * L;
        Dual<1> y[VALUES];
        respond(y, [&](int k) {
            V rate;
            if (k < FEATURES)
                rate = r.strain[k];
            else if (k < PARAMETERS)
                rate = r.x[k - FEATURES];
            else if (k < OUTPUTS)
                rate = load(parameter_rate + (k - PARAMETERS) * in.particles, at, end);
            else if (k >= REMEMBERED)
                rate = load(internal_rate + (k - REMEMBERED) * in.particles, at, end);
            else
                rate = network->get(network->gradient, LAYERS, group * L, k - OUTPUTS);
            return Dual<1>{value_at(group, k), {rate}};
        });
        V plain[VALUES], value[3], off[3][3], change[3][3];
        for (int k = 0; k < VALUES; k++) plain[k] = y[k].value;
        leave(group, plain, result);
        for (int k = 0; k < AFTER; k++) store(result_rate.internal + k * in.particles, at, end, y[3 + k].rate[0]);
        eigenvalues(plain, value);
        differences(group, value, off);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                change[i][j] =
                    i != j ? r.b[i][j] * off[i][j] : y[i].rate[0] * (Law::RETURN_MAP ? value[i] : splat(1.0));
        // Q change Q^T, or Q change Q^T F + M dF
        V turned[3][3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                V sum{};
                for (int k = 0; k < 3; k++) sum += change[i][k] * (Law::RETURN_MAP ? axes.g[k][j] : axes.q[j][k]);
                if (Law::RETURN_MAP)
                    sum += value[i] * (axes.q[0][i] * r.f[0][j] + axes.q[1][i] * r.f[1][j] + axes.q[2][i] * r.f[2][j]);
                turned[i][j] = sum;
            }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                V sum{};
                for (int k = 0; k < 3; k++) sum += axes.q[i][k] * turned[k][j];
                store(result_rate.matrix + (3 * i + j) * in.particles, at, end, sum);
            }
    }
};

}  // namespace pcnclaws
