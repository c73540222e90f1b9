// Principal stretches and axes of one deformation gradient of any scale and grading: entries from the smallest to the
// largest numbers beside each other. Slow; for what principal_axes leaves to it.
#pragma once
#include "standard.hpp"

namespace pcnclaws {

// F = Q G with Q orthogonal and the rows of G orthogonal to each other; whether det F > 0.
struct GradedAxes {
    double q[3][3], g[3][3];
    bool upright;
};

// A number to twice the digits of one (Dekker 1971, "A floating-point technique for extending the available precision").
struct Twofold {
    double high, low;

    static Twofold sum(double a, double b) {
        const double high = a + b, part = high - a;
        return {high, (a - (high - part)) + (b - part)};
    }
    static Twofold product(double a, double b) {
        const double high = a * b;
        return {high, std::fma(a, b, -high)};
    }
    Twofold operator+(const Twofold& other) const {
        const Twofold total = sum(high, other.high);
        return sum(total.high, total.low + (low + other.low));
    }
    Twofold operator*(double factor) const {
        const Twofold whole = product(high, factor);
        return sum(whole.high, std::fma(low, factor, whole.low));
    }
};

// Rows and columns of `a` in such an order, and factors, that a[rows[i]][columns[j]] = (L D U)_ij; L and U have a
// diagonal of 1 and no entry above 1, D falls. What elimination leaves of `a` are its minors over the pivots so far:
// formed of `a` itself and to twice the digits, they are right where differences of products cancel.
struct CompletelyPivoted {
    int rows[3] = {0, 1, 2}, columns[3] = {0, 1, 2};
    double l[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, d[3] = {}, u[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    bool even = true;  // the product of both permutations

    explicit CompletelyPivoted(const double a[3][3]) {
        double rest[3][3];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) rest[i][j] = a[i][j];
        eliminate(rest, 0);
        for (int i = 1; i < 3 && d[0] != 0.0; i++)
            for (int j = 1; j < 3; j++) rest[rows[i]][columns[j]] = minor(a, 0, i, 0, j).high / d[0];
        eliminate(rest, 1);
        if (d[1] == 0.0) return;
        auto cofactor = [&](int row, int i, int j) { return minor(a, i, j, 1, 2) * a[rows[row]][columns[0]]; };
        d[2] = (cofactor(0, 1, 2) + cofactor(1, 2, 0) + cofactor(2, 0, 1)).high / d[0] / d[1];
    }

    // det F > 0, by the signs alone
    bool upright() const {
        const bool negative = (d[0] < 0.0) != ((d[1] < 0.0) != (d[2] < 0.0));
        return d[2] != 0.0 && negative != even;
    }

   private:
    // Of two rows and two columns, as they are ordered by now.
    Twofold minor(const double a[3][3], int i, int j, int k, int l) const {
        const double *first = a[rows[i]], *second = a[rows[j]];
        return Twofold::product(first[columns[k]], second[columns[l]]) +
               Twofold::product(-first[columns[l]], second[columns[k]]);
    }
    void eliminate(const double rest[3][3], int k) {
        pivot_on_largest(rest, k);
        d[k] = rest[rows[k]][columns[k]];
        for (int i = k + 1; i < 3 && d[k] != 0.0; i++) {
            l[i][k] = rest[rows[i]][columns[k]] / d[k];
            u[k][i] = rest[rows[k]][columns[i]] / d[k];
        }
    }
    void pivot_on_largest(const double rest[3][3], int k) {
        int row = k, column = k;
        for (int i = k; i < 3; i++)
            for (int j = k; j < 3; j++)
                if (std::fabs(rest[rows[i]][columns[j]]) > std::fabs(rest[rows[row]][columns[column]])) {
                    row = i;
                    column = j;
                }
        for (int done = 0; done < k; done++) {
            exchange(l[row][done], l[k][done]);
            exchange(u[done][column], u[done][k]);
        }
        exchange(rows[row], rows[k]);
        exchange(columns[column], columns[k]);
        even = even == ((row == k) == (column == k));
    }
    template <class A> static void exchange(A& a, A& b) {
        const A kept = a;
        a = b;
        b = kept;
    }
};

// Orthonormal columns and an upper triangle: a = q r, by Gram and Schmidt, twice for columns that are nearly parallel.
inline void orthogonal_factor(const double a[3][3], double q[3][3], double r[3][3]) {
    for (int j = 0; j < 3; j++) {
        for (int i = 0; i < 3; i++) {
            q[i][j] = a[i][j];
            r[i][j] = 0.0;
        }
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < j; k++) {
                const double along = q[0][k] * q[0][j] + q[1][k] * q[1][j] + q[2][k] * q[2][j];
                for (int i = 0; i < 3; i++) q[i][j] -= along * q[i][k];
                r[k][j] += along;
            }
        r[j][j] = std::sqrt(q[0][j] * q[0][j] + q[1][j] * q[1][j] + q[2][j] * q[2][j]);
        for (int i = 0; i < 3; i++) q[i][j] /= r[j][j];
    }
}

// Makes rows p and r of G orthogonal and keeps Q G. Returns whether they were not.
inline bool turn_graded_rows(GradedAxes& out, int p, int r) {
    auto dot = [&](int a, int b) {
        return out.g[a][0] * out.g[b][0] + out.g[a][1] * out.g[b][1] + out.g[a][2] * out.g[b][2];
    };
    const double alpha = dot(p, p), beta = dot(r, r), gamma = dot(p, r);
    if (!(std::fabs(gamma) > 1e-16 * std::sqrt(alpha) * std::sqrt(beta))) return false;
    // the cotangent of twice the angle may overflow: then there is no angle
    const double cotangent = (beta - alpha) / (2.0 * gamma);
    const double size = std::fabs(cotangent) + std::sqrt(1.0 + cotangent * cotangent);
    const double tangent = (cotangent < 0.0 ? -1.0 : 1.0) / size, cosine = 1.0 / std::sqrt(1.0 + tangent * tangent);
    auto turn = [&](double& a, double& b) {
        const double before = a;
        a = cosine * (before - tangent * b);
        b = cosine * (b + tangent * before);
    };
    for (int k = 0; k < 3; k++) {
        turn(out.g[p][k], out.g[r][k]);
        turn(out.q[k][p], out.q[k][r]);
    }
    return true;
}

// Small stretches beside large ones to all digits that the entries of F determine: from F = L D U by complete pivoting
// and L D = Q R, one-sided Jacobi rotations of R U, whose rows fall as D does (Demmel et al. 1999, "Computing the
// singular value decomposition with high relative accuracy").
SLOW_PATH inline GradedAxes graded_axes(const double f[3][3]) {
    GradedAxes out;
    double largest = 0.0, sum = 0.0, scaled[3][3], q[3][3], r[3][3];
    for (int k = 0; k < 9; k++) {
        largest = std::max(largest, std::fabs(f[k / 3][k % 3]));
        sum += f[k / 3][k % 3];
    }
    // squares neither overflow nor vanish beside a largest entry of about 1; a power of two changes no digit
    int exponent = 0;
    std::frexp(largest, &exponent);
    for (int k = 0; k < 9; k++) scaled[k / 3][k % 3] = std::ldexp(f[k / 3][k % 3], -exponent);
    const CompletelyPivoted parts(scaled);
    out.upright = sum - sum == 0.0 && parts.upright();
    orthogonal_factor(parts.l, q, r);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double entry = 0.0;
            for (int k = i; k <= j; k++) entry += r[i][k] * parts.d[k] * parts.u[k][j];
            out.g[i][parts.columns[j]] = entry;
            out.q[parts.rows[i]][j] = q[i][j];
        }
    constexpr int MOST_SWEEPS = 40;
    bool turned = out.upright;
    for (int sweep = 0; sweep < MOST_SWEEPS && turned; sweep++) {
        turned = turn_graded_rows(out, 0, 1);
        turned |= turn_graded_rows(out, 0, 2);
        turned |= turn_graded_rows(out, 1, 2);
    }
    for (int k = 0; k < 9; k++) out.g[k / 3][k % 3] = std::ldexp(out.g[k / 3][k % 3], exponent);
    return out;
}

}  // namespace pcnclaws
