// Principal stretches and axes of several deformation gradients at once.
#pragma once
#include "lanes.hpp"

namespace pcnclaws {

// F = Q G with Q orthogonal and the rows of G orthogonal to each other: b = F F^T = Q diag(square) Q^T.
struct Principal {
    V q[3][3], g[3][3];
    V square[3];  // squares of the principal stretches
    V strain[3];  // principal Hencky strains, half the logarithms of the squares
};

// Tangent and cosine of the angle that makes two rows orthogonal. The angle itself needs no more than single precision,
// since the next sweep corrects it; cosine and sine belong together to double precision, by two Newton steps.
inline void rotation(V difference, V gamma, V& tangent, V& cosine) {
    typedef float Single __attribute__((vector_size(L * sizeof(float))));
    typedef int32_t SingleMask __attribute__((vector_size(L * sizeof(int32_t))));
    const Single d = __builtin_convertvector(difference, Single), g = 2.0f * __builtin_convertvector(gamma, Single);
    const Single root = square_root_of_lanes(d * d + g * g);
    const Single size = d < 0.0f ? d - root : d + root;
    const SingleMask turns = size != 0.0f;
    const Single t = turns ? g / (turns ? size : Single{} + 1.0f) : Single{};
    const Single c = 1.0f / square_root_of_lanes(1.0f + t * t);
    tangent = __builtin_convertvector(t, V);
    cosine = __builtin_convertvector(c, V);
    const V half = 0.5 + 0.5 * tangent * tangent;
    for (int step = 0; step < 2; step++) cosine *= 1.5 - half * cosine * cosine;
}

// Makes rows p and r of G orthogonal. Returns the particles that the next sweep still turns: it squares the angles.
inline Mask turn(Principal& out, int p, int r) {
    auto dot = [&](int a, int b) {
        return out.g[a][0] * out.g[b][0] + out.g[a][1] * out.g[b][1] + out.g[a][2] * out.g[b][2];
    };
    const V alpha = dot(p, p), beta = dot(r, r), gamma = dot(p, r);
    V tangent, cosine;
    rotation(beta - alpha, gamma, tangent, cosine);
    const V sine = tangent * cosine;
    for (int k = 0; k < 3; k++) {
        const V gp = out.g[p][k], gr = out.g[r][k], qp = out.q[k][p], qr = out.q[k][r];
        out.g[p][k] = cosine * gp - sine * gr;
        out.g[r][k] = sine * gp + cosine * gr;
        out.q[k][p] = cosine * qp - sine * qr;
        out.q[k][r] = sine * qp + cosine * qr;
    }
    return (tangent * tangent > 1e-17) & (gamma * gamma > 1e-30 * alpha * beta);
}

inline V determinant(const V f[3][3]) {
    return f[0][0] * (f[1][1] * f[2][2] - f[1][2] * f[2][1]) + f[0][1] * (f[1][2] * f[2][0] - f[1][0] * f[2][2]) +
           f[0][2] * (f[1][0] * f[2][1] - f[1][1] * f[2][0]);
}

// One-sided Jacobi rotations of the rows (Hestenes 1958, "Inversion of matrices by biorthogonalization"): F F^T is
// never formed, so that small stretches beside large ones keep their digits. Several groups of particles in step: one
// rotation is a long chain of dependent operations.
template <int GROUPS> void principal_axes(const V f[GROUPS][3][3], Principal out[GROUPS]) {
    for (int n = 0; n < GROUPS; n++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                out[n].g[i][j] = f[n][i][j];
                out[n].q[i][j] = splat(i == j);
            }
    constexpr int MOST_SWEEPS = 12;
    for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        Mask turning{};
        for (int n = 0; n < GROUPS; n++) turning |= turn(out[n], 0, 1);
        for (int n = 0; n < GROUPS; n++) turning |= turn(out[n], 0, 2);
        for (int n = 0; n < GROUPS; n++) turning |= turn(out[n], 1, 2);
        int64_t any = 0;
        for (int l = 0; l < L; l++) any |= turning[l];
        if (!any) break;
    }
    for (int n = 0; n < GROUPS; n++)
        for (int i = 0; i < 3; i++) {
            out[n].square[i] =
                out[n].g[i][0] * out[n].g[i][0] + out[n].g[i][1] * out[n].g[i][1] + out[n].g[i][2] * out[n].g[i][2];
            // a body turned inside out has no strain
            out[n].strain[i] = select(determinant(f[n]) > 0.0, 0.5 * logarithm(out[n].square[i]), splat(NAN));
        }
}

// Two stretches meet where the rounding of their difference weighs as much as the curvature of a law that flows at
// strains of 1e-6.
constexpr double MEETING = 1e-9;

// Derivative of an isotropic function off the diagonal, in principal axes: (y_i - y_j)/(b_i - b_j), and where the two
// stretches meet its limit (Daleckii and Krein 1965), from `slope`, [i][j] = d y_i / d h_j. `slope` is asked for only
// when two stretches of some particle meet.
template <class Slope> void divided_differences(const Principal& principal, const V y[3], Slope slope, V off[3][3]) {
    constexpr int PAIRS[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    int64_t any = 0;
    Mask meets[3];
    for (int n = 0; n < 3; n++) {
        const V bi = principal.square[PAIRS[n][0]], bj = principal.square[PAIRS[n][1]];
        meets[n] = absolute(bi - bj) <= MEETING * (bi + bj);
        for (int l = 0; l < L; l++) any |= meets[n][l];
    }
    V s[3][3]{};
    if (any) slope(s);
    for (int n = 0; n < 3; n++) {
        const int i = PAIRS[n][0], j = PAIRS[n][1];
        const V bi = principal.square[i], bj = principal.square[j];
        const V limit = 0.25 * ((s[i][i] - s[j][i]) / bi + (s[j][j] - s[i][j]) / bj);
        off[i][j] = off[j][i] = select(meets[n], limit, (y[i] - y[j]) / select(meets[n], splat(1.0), bi - bj));
    }
}

}  // namespace pcnclaws
