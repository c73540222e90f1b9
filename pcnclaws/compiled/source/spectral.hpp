// Principal stretches and axes of several deformation gradients at once.
#pragma once
#include "fallbacks.hpp"
#include "graded_axes.hpp"
#include "lanes.hpp"

namespace pcnclaws {

// F = Q G with Q orthogonal and the rows of G orthogonal to each other: b = F F^T = Q diag(square) Q^T.
struct Principal {
    V q[3][3], g[3][3];
    V square[3];  // squares of the principal stretches
    V strain[3];  // principal Hencky strains, half the logarithms of the squares
};

// Below, the squares under the root have lost their digits: the tangent, which should be 1 at most, could be anything.
constexpr float LEAST_ROOT = 1e-18f;

// Tangent and cosine of the angle that makes two rows orthogonal, from the difference of their squares and twice their
// product. Beside rows of about 1 no angle is needed where both are smaller than LEAST_ROOT.
template <class S> void rotation(S difference, S twice, S& tangent, S& cosine) {
    const S root = square_root_of_lanes(difference * difference + twice * twice);
    const S size = difference < 0.0f ? difference - root : difference + root;
    const auto turns = root > LEAST_ROOT;
    tangent = turns ? twice / (turns ? size : S{} + 1.0f) : S{};
    cosine = 1.0f / square_root_of_lanes(1.0f + tangent * tangent);
}
// The angle itself needs no more than single precision, since the next sweep corrects it; cosine and sine belong
// together to double precision, by two Newton steps.
inline void rotation(V difference, V twice, V& tangent, V& cosine) {
    Half t, c;
    rotation(converted<Half>(difference), converted<Half>(twice), t, c);
    tangent = converted<V>(t);
    cosine = converted<V>(c);
    const V half = 0.5 + 0.5 * tangent * tangent;
    for (int step = 0; step < 2; step++) cosine *= 1.5 - half * cosine * cosine;
}

// Two numbers turned by an angle.
template <class S> void turn(S cosine, S sine, S& a, S& b) {
    const S before = a;
    a = cosine * before - sine * b;
    b = sine * before + cosine * b;
}

// Makes rows p and r of G orthogonal. Returns the particles that the next sweep still turns, by more than
// sqrt(negligible): each sweep squares the angles.
inline Mask turn_rows(Principal& out, int p, int r, double negligible) {
    auto dot = [&](int a, int b) {
        return out.g[a][0] * out.g[b][0] + out.g[a][1] * out.g[b][1] + out.g[a][2] * out.g[b][2];
    };
    const V alpha = dot(p, p), beta = dot(r, r), gamma = dot(p, r);
    V tangent, cosine;
    rotation(beta - alpha, 2.0 * gamma, tangent, cosine);
    const V sine = tangent * cosine;
    for (int k = 0; k < 3; k++) {
        turn(cosine, sine, out.g[p][k], out.g[r][k]);
        turn(cosine, sine, out.q[k][p], out.q[k][r]);
    }
    return (tangent * tangent > negligible) & (gamma * gamma > 1e-30 * alpha * beta);
}

// A symmetric matrix of two groups without its trace, which does not change the axes: the diagonal less its first
// entry, and the entries 01, 02, 12 off it; and the axes found so far.
struct Symmetric {
    Singles diagonal[3], off[3], q[3][3];

    // Jacobi rotation of rows and columns p and r. Entries off the diagonal: pr, and pk and rk to the third row k.
    void turn_rows(int p, int r, int pr, int pk, int rk) {
        Singles tangent, cosine;
        rotation<Singles>(diagonal[r] - diagonal[p], 2.0f * off[pr], tangent, cosine);
        const Singles sine = tangent * cosine, moved = tangent * off[pr];
        diagonal[p] -= moved;
        diagonal[r] += moved;
        off[pr] = Singles{};
        turn(cosine, sine, off[pk], off[rk]);
        for (int k = 0; k < 3; k++) turn(cosine, sine, q[k][p], q[k][r]);
    }
};

// b = F F^T for `approximate_axes`
inline void load_square(const V f[3][3], int which, Symmetric& out) {
    auto dot = [&](int a, int b) { return f[a][0] * f[b][0] + f[a][1] * f[b][1] + f[a][2] * f[b][2]; };
    const V first = dot(0, 0), second = dot(1, 1), third = dot(2, 2);
    // what single precision cannot square is left to double precision
    const V scale = select(first + second + third < 1e18, splat(1.0), V{});
    const V diagonal[] = {V{}, second - first, third - first}, off[] = {dot(0, 1), dot(0, 2), dot(1, 2)};
    for (int k = 0; k < 3; k++) {
        put_half(out.diagonal[k], which, scale * diagonal[k]);
        put_half(out.off[k], which, scale * off[k]);
    }
}

// Columns that are orthonormal to single precision, made so to double precision (Gram and Schmidt). Returns where they
// were not, and are not now.
inline Mask orthonormalise(V q[3][3]) {
    constexpr double SINGLE = 1e-5;  // the cube of what single precision leaves is nothing in double precision
    auto along = [&](int a, int b) { return q[0][a] * q[0][b] + q[1][a] * q[1][b] + q[2][a] * q[2][b]; };
    auto normalise = [&](int a) {
        const V excess = along(a, a) - 1.0, factor = 1.0 + excess * (0.375 * excess - 0.5);
        for (int i = 0; i < 3; i++) q[i][a] *= factor;
        return excess;
    };
    const V first = normalise(0), common = along(0, 1);
    for (int i = 0; i < 3; i++) q[i][1] -= common * q[i][0];
    const V second = normalise(1);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        q[i][2] = q[j][0] * q[k][1] - q[k][0] * q[j][1];
    }
    // a comparison with NaN is false
    return !(maximum(absolute(first), maximum(absolute(second), absolute(common))) < SINGLE);
}

// Axes right to single precision, in half the time that it takes in double. Says where they are no axes at all.
template <int GROUPS> void approximate_axes(const V f[GROUPS][3][3], Principal out[GROUPS], Mask wrong[GROUPS]) {
    static_assert(GROUPS % HALVES == 0, "groups share vectors");
    constexpr int PAIRS = GROUPS / HALVES, SWEEPS = 3;
    Symmetric b[PAIRS];
    for (int n = 0; n < GROUPS; n++) load_square(f[n], n % HALVES, b[n / HALVES]);
    for (int n = 0; n < PAIRS; n++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) b[n].q[i][j] = Singles{} + float(i == j);
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        for (int n = 0; n < PAIRS; n++) b[n].turn_rows(0, 1, 0, 1, 2);
        for (int n = 0; n < PAIRS; n++) b[n].turn_rows(0, 2, 1, 0, 2);
        for (int n = 0; n < PAIRS; n++) b[n].turn_rows(1, 2, 2, 0, 1);
    }
    for (int n = 0; n < GROUPS; n++) {
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) out[n].q[i][j] = get_half(b[n / HALVES].q[i][j], n % HALVES);
        wrong[n] = orthonormalise(out[n].q);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                out[n].g[i][j] =
                    out[n].q[0][i] * f[n][0][j] + out[n].q[1][i] * f[n][1][j] + out[n].q[2][i] * f[n][2][j];
    }
}

inline V determinant(const V f[3][3]) {
    return f[0][0] * (f[1][1] * f[2][2] - f[1][2] * f[2][1]) + f[0][1] * (f[1][2] * f[2][0] - f[1][0] * f[2][2]) +
           f[0][2] * (f[1][0] * f[2][1] - f[1][1] * f[2][0]);
}

// Replaces what was found for some of the first `count` particles.
CALLS_SLOW_PATH void find_graded_axes(const V f[3][3], Mask wanted, int64_t count, Principal& out) {
    for (int lane = 0; lane < std::min(int64_t(L), count); lane++) {
        if (!lane_of(wanted, lane)) continue;
        double plain[3][3];
        for (int k = 0; k < 9; k++) plain[k / 3][k % 3] = lane_of(f[k / 3][k % 3], lane);
        const GradedAxes found = graded_axes(plain);
        for (int i = 0; i < 3; i++) {
            double square = 0.0;
            for (int j = 0; j < 3; j++) {
                set_lane(out.q[i][j], lane, found.q[i][j]);
                set_lane(out.g[i][j], lane, found.g[i][j]);
                square += found.g[i][j] * found.g[i][j];
            }
            set_lane(out.square[i], lane, square);
            set_lane(out.strain[i], lane, found.upright ? 0.5 * std::log(square) : NAN);
        }
        count_fallback();
    }
}

// One-sided Jacobi rotations of the rows (Hestenes 1958, "Inversion of matrices by biorthogonalization"): F F^T is
// formed for a first guess alone, so that small stretches beside large ones keep their digits. Several groups of
// particles in step: one rotation is a long chain of dependent operations. For states of precision T.
//
// The first guess is in single precision, which serves stretches of about 1. What it does not serve, by the
// orthogonality of its axes or by the stretches found in the end, is `left` to find_graded_axes.
template <class T, int GROUPS>
void principal_axes(const V f[GROUPS][3][3], Principal out[GROUPS], Mask left[GROUPS]) {
    approximate_axes<GROUPS>(f, out, left);
    constexpr int MOST_SWEEPS = 12;
    constexpr double NEGLIGIBLE = sizeof(T) == sizeof(float) ? 1e-10 : 1e-17;
    // squares of the stretches that the sweeps serve
    constexpr double LEAST = 1e-4, MOST = 1e4;
    for (int sweep = 0; sweep < MOST_SWEEPS; sweep++) {
        Mask turning{};
        for (int n = 0; n < GROUPS; n++) turning |= turn_rows(out[n], 0, 1, NEGLIGIBLE);
        for (int n = 0; n < GROUPS; n++) turning |= turn_rows(out[n], 0, 2, NEGLIGIBLE);
        for (int n = 0; n < GROUPS; n++) turning |= turn_rows(out[n], 1, 2, NEGLIGIBLE);
        if (!any(turning)) break;
    }
    for (int n = 0; n < GROUPS; n++)
        for (int i = 0; i < 3; i++) {
            out[n].square[i] =
                out[n].g[i][0] * out[n].g[i][0] + out[n].g[i][1] * out[n].g[i][1] + out[n].g[i][2] * out[n].g[i][2];
            // a body turned inside out has no strain
            out[n].strain[i] = select(determinant(f[n]) > 0.0, 0.5 * logarithm(out[n].square[i]), splat(NAN));
            left[n] |= !((out[n].square[i] > LEAST) & (out[n].square[i] < MOST));
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
    Mask meets[3], meeting{};
    for (int n = 0; n < 3; n++) {
        const V bi = principal.square[PAIRS[n][0]], bj = principal.square[PAIRS[n][1]];
        meets[n] = absolute(bi - bj) <= MEETING * (bi + bj);
        meeting |= meets[n];
    }
    V s[3][3]{};
    if (any(meeting)) slope(s);
    for (int n = 0; n < 3; n++) {
        const int i = PAIRS[n][0], j = PAIRS[n][1];
        const V bi = principal.square[i], bj = principal.square[j];
        const V limit = 0.25 * ((s[i][i] - s[j][i]) / bi + (s[j][j] - s[i][j]) / bj);
        off[i][j] = off[j][i] = select(meets[n], limit, (y[i] - y[j]) / select(meets[n], splat(1.0), bi - bj));
    }
}

}  // namespace pcnclaws
