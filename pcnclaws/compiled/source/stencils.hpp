// The 27 nodes of a particle: their weights, what goes to them and what comes back.
#pragma once
#include "standard.hpp"

#include "numbers.hpp"

namespace pcnclaws {

// particles whose weights are computed together
#ifdef ONE_LANE
constexpr int LANE = 1;
#else
constexpr int LANE = 16;
#endif

// A box of grid nodes, inclusive.
struct Box {
    int low[3], high[3];
    int edge(int axis) const { return high[axis] - low[axis] + 1; }
    size_t size() const { return size_t(edge(0)) * edge(1) * edge(2); }
    size_t index(int x, int y, int z) const {
        return (size_t(x - low[0]) * edge(1) + (y - low[1])) * edge(2) + (z - low[2]);
    }
};

inline Box empty_box() {
    const int far = std::numeric_limits<int>::max() / 2;
    return {{far, far, far}, {-far, -far, -far}};
}
inline void join(Box& box, const Box& other) {
    for (int a = 0; a < 3; a++) {
        box.low[a] = std::min(box.low[a], other.low[a]);
        box.high[a] = std::max(box.high[a], other.high[a]);
    }
}

struct Settings {
    double time_step;
    double origin[3];            // place of node 0
    double per_metre;            // cells in a metre
    Box grid;                    // the nodes that there are
    int64_t contact;             // of walls: SEPARATE, ...
    int64_t window;              // 1 for the touched window of the grid, 0 for the whole grid
    const unsigned char* walls;  // of the nodes of the grid along each axis: bit 0 low wall, bit 1 high wall; or null
    int64_t order = 1;           // of the affine XPIC of the transfer, see terms.hpp: 1 for APIC

    // of the nodes along an axis, from the first one of the grid on
    const unsigned char* walls_of(int axis) const {
        return walls ? walls + (axis > 0 ? grid.edge(0) : 0) + (axis > 1 ? grid.edge(1) : 0) : nullptr;
    }
    int wall_at(int axis, int node) const { return walls ? walls_of(axis)[node - grid.low[axis]] : 0; }
};

// The middle node of a particle's stencil. A diverged particle, which the rollout reports, borrows the nearest one.
template <class T> int middle_node(T scaled, T first, T last) {
    T node = std::floor(scaled + T(0.5));
    node = node > first ? node : first;  // also where it is not a number
    return int(node < last ? node : last);
}

// Weights and values of LANE particles: what stays the same for all nodes of a stencil.
template <class S> struct Stencils {
    typedef typename Plain<S>::type T;
    int middle[3][LANE];
    S weight[3][3][LANE], slope[3][3][LANE];  // B-spline weights by axis and node, and their derivatives
    S from_middle[3][LANE];                   // d, in units of dx

    void find(const Settings& settings, const Field<S>& position, int64_t particles, int64_t first, int count) {
        const T per_metre = T(settings.per_metre);
        for (int axis = 0; axis < 3; axis++) {
            const T origin = T(settings.origin[axis]);
            const T low = T(settings.grid.low[axis] + 1), high = T(settings.grid.high[axis] - 1);
            for (int l = 0; l < count; l++) {
                S from_origin = position.get(axis * particles + first + l);
                subtract(from_origin, origin);
                const S scaled_position = scaled(per_metre, from_origin);
                middle[axis][l] = middle_node(value_of(scaled_position), low, high);
                S d = scaled_position;
                subtract(d, T(middle[axis][l]));
                from_middle[axis][l] = d;
                S low = scaled(T(-1), d), high = d, squared = d * d, inner = scaled(T(-1), squared);
                subtract(low, T(-0.5));
                subtract(high, T(-0.5));
                subtract(inner, T(-0.75));
                weight[axis][0][l] = scaled(T(0.5), low * low);
                weight[axis][1][l] = inner;
                S upper = d;
                subtract(upper, T(-0.5));
                weight[axis][2][l] = scaled(T(0.5), upper * upper);
                slope[axis][0][l] = scaled(T(-1), low);
                slope[axis][1][l] = scaled(T(-2), d);
                slope[axis][2][l] = upper;
            }
        }
    }
    // a - by
    static void subtract(T& a, T by) { a -= by; }
    static void subtract(Rate<T>& a, T by) { a.value -= by; }
};

// Adds the weighted values a + i b_x + j b_y + k b_z to the 27 nodes of a particle.
template <class S>
void scatter(const Stencils<S>& stencils, int l, const Quad<S> vectors[4], const Box& box, Quad<S>* to) {
    const int x = stencils.middle[0][l] - 1, y = stencils.middle[1][l] - 1, z = stencils.middle[2][l] - 1;
    const S w0 = stencils.weight[2][0][l], w1 = stencils.weight[2][1][l], w2 = stencils.weight[2][2][l];
    Quad<S> along_x = vectors[0] - vectors[1];
    for (int i = 0; i < 3; i++, along_x = along_x + vectors[1]) {
        Quad<S> along_y = along_x - vectors[2];
        for (int j = 0; j < 3; j++, along_y = along_y + vectors[2]) {
            const S w = stencils.weight[0][i][l] * stencils.weight[1][j][l];
            Quad<S>* row = to + box.index(x + i, y + j, z);
            add_to(row[0], (along_y - vectors[3]) * (w * w0));
            add_to(row[1], along_y * (w * w1));
            add_to(row[2], (along_y + vectors[3]) * (w * w2));
        }
    }
}

// Weighted sums of node values over the stencil: [0] plain, [1 + axis] the first moments about the middle node.
template <class S>
void gather(const Stencils<S>& stencils, int l, const Box& box, const Quad<S>* from, Quad<S> sums[4]) {
    const int x = stencils.middle[0][l] - 1, y = stencils.middle[1][l] - 1, z = stencils.middle[2][l] - 1;
    const S w0 = stencils.weight[2][0][l], w1 = stencils.weight[2][1][l], w2 = stencils.weight[2][2][l];
    Quad<S> by_x[3]{}, by_y[3]{}, along_z{};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const S w = stencils.weight[0][i][l] * stencils.weight[1][j][l];
            const Quad<S>* row = from + box.index(x + i, y + j, z);
            const Quad<S> low = row[0] * (w * w0), high = row[2] * (w * w2), all = low + row[1] * (w * w1) + high;
            by_x[i] += all;
            by_y[j] += all;
            along_z += high - low;
        }
    sums[0] = by_x[0] + by_x[1] + by_x[2];
    sums[1] = by_x[2] - by_x[0];
    sums[2] = by_y[2] - by_y[0];
    sums[3] = along_z;
}

// d r / d x in units of dx, where r = sum of w times what the particle and the node exchange, back and forth.
template <class T>
void weight_gradient(const Stencils<T>& stencils, int l, const Box& box, const Quad<T>* velocities,
                     const Quad<T>* gradients, const Quad<T> back[4], const Quad<T> forth[4], T d[3]) {
    const int x = stencils.middle[0][l] - 1, y = stencils.middle[1][l] - 1, z = stencils.middle[2][l] - 1;
    Quad<T> sum[3]{};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const size_t at = box.index(x + i, y + j, z);
            Quad<T> b = back[0] + T(i - 1) * back[1] + T(j - 1) * back[2] - back[3];
            Quad<T> f = forth[0] + T(i - 1) * forth[1] + T(j - 1) * forth[2] - forth[3];
            Quad<T> along{}, change{};
            for (int k = 0; k < 3; k++, b += back[3], f += forth[3]) {
                const Quad<T> exchanged = velocities[at + k] * b + gradients[at + k] * f;
                along += stencils.weight[2][k][l] * exchanged;
                change += stencils.slope[2][k][l] * exchanged;
            }
            sum[0] += (stencils.slope[0][i][l] * stencils.weight[1][j][l]) * along;
            sum[1] += (stencils.weight[0][i][l] * stencils.slope[1][j][l]) * along;
            sum[2] += (stencils.weight[0][i][l] * stencils.weight[1][j][l]) * change;
        }
    for (int axis = 0; axis < 3; axis++) d[axis] = sum[axis][0] + sum[axis][1] + sum[axis][2] + sum[axis][3];
}

}  // namespace pcnclaws
