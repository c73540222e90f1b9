// Reverse-mode differentiation of a short formula: every operation is written down with its derivatives.
#pragma once
#include "lanes.hpp"

namespace pcnclaws {

constexpr int MOST_OPERATIONS = LAW_OPERATIONS;  // and inputs, of the law

// What is written down. Apart from the number of operations, which a compiler then knows in advance: on a GPU all of it
// can stay in registers.
struct TapeEntries {
    V slope[MOST_OPERATIONS][2];
    int parent[MOST_OPERATIONS][2];
    V gradient[MOST_OPERATIONS];
};

struct Tape {
    TapeEntries& entries;
    int count = 0;

    explicit Tape(TapeEntries& memory) : entries(memory) {}

    int record(int a, V of_a) {
        if (count == MOST_OPERATIONS) stop();  // a law has outgrown the tape
        entries.parent[count][0] = a;
        entries.parent[count][1] = -1;
        entries.slope[count][0] = of_a;
        entries.gradient[count] = V{};
        return count++;
    }
    int record(int a, V of_a, int b, V of_b) {
        const int entry = record(a, of_a);
        entries.parent[entry][1] = b;
        entries.slope[entry][1] = of_b;
        return entry;
    }

    // from the gradients that were added to some entries to those of all entries before them
    void sweep() {
#ifdef ONE_LANE
        // as many turns as a compiler can count: nothing of the tape is left then but its arithmetic
#pragma unroll
        for (int k = MOST_OPERATIONS - 1; k >= 0; k--)
            if (k < count) pass_on(k);
#else
        for (int k = count - 1; k >= 0; k--) pass_on(k);
#endif
    }

  private:
    void pass_on(int k) {
        for (int side = 0; side < 2; side++) {
            const int parent = entries.parent[k][side];
            if (parent >= 0) entries.gradient[parent] += entries.slope[k][side] * entries.gradient[k];
        }
    }
};

// A value and its entry on a tape, -1 for a constant.
struct Taped {
    V value;
    Tape* tape;
    int entry;
};

inline Taped variable(V value, Tape& tape) { return {value, &tape, tape.record(-1, V{})}; }
inline Taped constant(V value, const Taped& like) { return {value, like.tape, -1}; }
inline V value_of(const Taped& a) { return a.value; }

inline Taped chain(const Taped& a, V value, V slope) { return {value, a.tape, a.tape->record(a.entry, slope)}; }
inline Taped operator+(const Taped& a, const Taped& b) {
    return {a.value + b.value, a.tape, a.tape->record(a.entry, splat(1.0), b.entry, splat(1.0))};
}
inline Taped operator-(const Taped& a, const Taped& b) {
    return {a.value - b.value, a.tape, a.tape->record(a.entry, splat(1.0), b.entry, splat(-1.0))};
}
inline Taped operator*(const Taped& a, const Taped& b) {
    return {a.value * b.value, a.tape, a.tape->record(a.entry, b.value, b.entry, a.value)};
}
inline Taped operator/(const Taped& a, const Taped& b) {
    const V inverse = 1.0 / b.value, quotient = a.value * inverse;
    return {quotient, a.tape, a.tape->record(a.entry, inverse, b.entry, -quotient * inverse)};
}
inline Taped select(Mask mask, const Taped& yes, const Taped& no) {
    const V one = splat(1.0), zero{};
    const int entry = yes.tape->record(yes.entry, select(mask, one, zero), no.entry, select(mask, zero, one));
    return {select(mask, yes.value, no.value), yes.tape, entry};
}

}  // namespace pcnclaws
