// Several particles at once: vectors as wide as the processor's registers, elementary functions of them, and dual
// numbers that carry derivatives through the same code.
#pragma once
#include "standard.hpp"

#ifdef ONE_LANE
#include "one_lane.hpp"
#else

namespace pcnclaws {

// A compiler takes vectors that are wider than the registers apart, number by number where it compares them: ten times
// slower.
#if defined(__AVX512F__)
constexpr int BYTES = 64;
#elif defined(__AVX__)
constexpr int BYTES = 32;
#else
constexpr int BYTES = 16;
#endif

template <class T> struct VectorOf {
    typedef T type __attribute__((vector_size(BYTES)));
};
template <class T> using Vector = typename VectorOf<T>::type;
template <class T> constexpr int LANES = BYTES / int(sizeof(T));

// Laws are evaluated in double precision for every precision of the state: a small strain is the difference of
// stretches near 1.
using V = Vector<double>;
using Mask = Vector<int64_t>;
constexpr int L = LANES<double>;

inline V splat(double x) { return V{} + x; }
inline V select(Mask mask, V yes, V no) { return mask ? yes : no; }
inline V maximum(V a, V b) { return select(a > b, a, b); }
inline V minimum(V a, V b) { return select(a < b, a, b); }
inline V absolute(V a) { return maximum(a, -a); }
inline bool any(Mask mask) {
    int64_t found = 0;
    for (int l = 0; l < L; l++) found |= mask[l];
    return found != 0;
}
template <class To, class From> To converted(From a) { return __builtin_convertvector(a, To); }
inline double lane_of(V a, int lane) { return a[lane]; }
inline bool lane_of(Mask mask, int lane) { return mask[lane] != 0; }
inline void set_lane(V& a, int lane, double x) { a[lane] = x; }

// lane by lane through memory, which the compiler turns into one instruction
template <class U> U square_root_of_lanes(U a) {
    constexpr int count = sizeof(U) / sizeof(a[0]);
    std::remove_reference_t<decltype(a[0])> lanes[count];
    std::memcpy(lanes, &a, sizeof a);
    for (int l = 0; l < count; l++) lanes[l] = std::sqrt(lanes[l]);
    std::memcpy(&a, lanes, sizeof a);
    return a;
}
inline V square_root(V a) { return square_root_of_lanes(a); }

// e^x to rounding: x = n ln 2 + r, Taylor polynomial of r in [-0.35, 0.35]. Saturates instead of overflowing.
inline V exponential(V x) {
    x = select(x < -700.0, splat(-700.0), select(x > 700.0, splat(700.0), x));
    const V shift = splat(6755399441055744.0);  // 1.5 * 2^52: adding it rounds to the nearest whole number
    const V n = (x * 1.4426950408889634 + shift) - shift;
    const V r = (x - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    V sum = splat(1.0 / 6227020800.0);
    const double factors[] = {479001600.0, 39916800.0, 3628800.0, 362880.0, 40320.0, 5040.0, 720.0,
                              120.0,       24.0,       6.0,       2.0,      1.0,     1.0};
    for (double factor : factors) sum = sum * r + 1.0 / factor;
    const Mask power = (__builtin_convertvector(n, Mask) + 1023) << 52;
    V scale;
    std::memcpy(&scale, &power, sizeof scale);
    return sum * scale;
}

// log x to rounding for positive x: x = 2^n m with m in [sqrt(1/2), sqrt(2)], log m = 2 artanh((m - 1)/(m + 1)).
inline V logarithm(V x) {
    Mask bits;
    std::memcpy(&bits, &x, sizeof bits);
    // the offset moves the mantissa's interval from [1, 2) to [sqrt(1/2), sqrt(2))
    const Mask n = (bits - 0x3fe6a09e667f3bcd) >> 52;
    const Mask mantissa = bits - (n << 52);
    V m;
    std::memcpy(&m, &mantissa, sizeof m);
    const V z = (m - 1.0) / (m + 1.0), z2 = z * z;
    V sum = splat(1.0 / 23.0);
    for (int k = 21; k >= 1; k -= 2) sum = sum * z2 + 1.0 / k;
    return 2.0 * z * sum + __builtin_convertvector(n, V) * 0.6931471805599453;
}

// L particles of one row of a component-first array; beyond the end the last particle is repeated.
template <class T> V load(const T* row, int64_t first, int64_t end) {
    typedef T Part __attribute__((vector_size(L * sizeof(T))));
    Part part;
    if (first + L <= end) {
        std::memcpy(&part, row + first, sizeof part);
    } else {
        for (int l = 0; l < L; l++) part[l] = row[std::min<int64_t>(first + l, end - 1)];
    }
    return __builtin_convertvector(part, V);
}
template <class T> void store(T* row, int64_t first, int64_t end, V values) {
    typedef T Part __attribute__((vector_size(L * sizeof(T))));
    const Part part = __builtin_convertvector(values, Part);
    if (first + L <= end) {
        std::memcpy(row + first, &part, sizeof part);
    } else {
        for (int l = 0; first + l < end; l++) row[first + l] = part[l];
    }
}

// Two groups of particles in single precision.
typedef Vector<float> Singles;
typedef float Half __attribute__((vector_size(L * sizeof(float))));
constexpr int HALVES = 2;
inline void put_half(Singles& whole, int which, V values) {
    const Half half = converted<Half>(values);
    std::memcpy(reinterpret_cast<char*>(&whole) + which * sizeof half, &half, sizeof half);
}
inline V get_half(const Singles& whole, int which) {
    Half half;
    std::memcpy(&half, reinterpret_cast<const char*>(&whole) + which * sizeof half, sizeof half);
    return converted<V>(half);
}

}  // namespace pcnclaws

#endif

namespace pcnclaws {

// A value and its derivatives in N directions.
template <int N> struct Dual {
    V value;
    V rate[N];
};

template <int N> Dual<N> constant(V value, const Dual<N>&) {
    Dual<N> out;
    out.value = value;
    for (int n = 0; n < N; n++) out.rate[n] = V{};
    return out;
}
inline V constant(V value, const V&) { return value; }

template <int N> Dual<N> variable(V value, int direction) {
    Dual<N> out = constant(value, Dual<N>{});
    out.rate[direction] += 1.0;
    return out;
}

// f(a) from its value and its derivative
inline V chain(V, V value, V) { return value; }
template <int N> Dual<N> chain(const Dual<N>& a, V value, V slope) {
    Dual<N> out;
    out.value = value;
    for (int n = 0; n < N; n++) out.rate[n] = slope * a.rate[n];
    return out;
}

template <int N> Dual<N> operator+(const Dual<N>& a, const Dual<N>& b) {
    Dual<N> out;
    out.value = a.value + b.value;
    for (int n = 0; n < N; n++) out.rate[n] = a.rate[n] + b.rate[n];
    return out;
}
template <int N> Dual<N> operator-(const Dual<N>& a, const Dual<N>& b) {
    Dual<N> out;
    out.value = a.value - b.value;
    for (int n = 0; n < N; n++) out.rate[n] = a.rate[n] - b.rate[n];
    return out;
}
template <int N> Dual<N> operator*(const Dual<N>& a, const Dual<N>& b) {
    Dual<N> out;
    out.value = a.value * b.value;
    for (int n = 0; n < N; n++) out.rate[n] = a.value * b.rate[n] + a.rate[n] * b.value;
    return out;
}
template <int N> Dual<N> operator/(const Dual<N>& a, const Dual<N>& b) {
    Dual<N> out;
    const V inverse = 1.0 / b.value;
    out.value = a.value * inverse;
    for (int n = 0; n < N; n++) out.rate[n] = (a.rate[n] - out.value * b.rate[n]) * inverse;
    return out;
}
template <int N> Dual<N> select(Mask mask, const Dual<N>& yes, const Dual<N>& no) {
    Dual<N> out;
    out.value = select(mask, yes.value, no.value);
    for (int n = 0; n < N; n++) out.rate[n] = select(mask, yes.rate[n], no.rate[n]);
    return out;
}

inline V value_of(V a) { return a; }
template <int N> V value_of(const Dual<N>& a) { return a.value; }

}  // namespace pcnclaws
