// Affine XPIC: what one particle and one node do beside a step of APIC. The velocities of the nodes before forces are a
// sum of terms, v_0 + (I - A) v_0 + ...; pcnclaws/mpm/transfer.py states the method and its source.
#pragma once
#include "stencils.hpp"

namespace pcnclaws {

constexpr int MOST_RETURNS = 3;  // of terms to the particles and back: an order of 4

// Terms that went to the particles and back, and the gradients at the momenta of what this made of them.
template <class S> struct Terms {
    int64_t count;
    const Quad<S>*velocity[MOST_RETURNS], *gradient[MOST_RETURNS];
};

// What goes back to the grid: what came, in the adjoint; its negative; and with it, in the last return, the stress.
enum Return { ADJOINT, TERM, LAST_TERM };

// Masses so small that a division by them could overflow in the adjoint count as none.
template <class S> bool occupied(const Quad<S>& node) {
    typedef typename Plain<S>::type T;
    return value_of(component(node, 3)) > std::numeric_limits<T>::min() * T(1e3);
}

template <class S> S as_number(typename Plain<S>::type a) {
    S number{};
    Stencils<S>::subtract(number, -a);
    return number;
}

// The velocity of a node from its momentum and mass, and 0.
template <class S> Quad<S> first_term(const Quad<S>& node) {
    typedef typename Plain<S>::type T;
    if (!occupied<S>(node)) return Quad<S>{};
    Quad<S> velocity = node * (as_number<S>(T(1)) / component(node, 3));
    set_component(velocity, 3, S{});
    return velocity;
}

// Adds the next term to the momentum of a node, from the term before it and what came back of this; the term.
template <class S> Quad<S> next_term(Quad<S>& node, const Quad<S>& term, const Quad<S>& change) {
    typedef typename Plain<S>::type T;
    if (!occupied<S>(node)) {
        node += change;
        return Quad<S>{};
    }
    const S mass = component(node, 3);
    node += term * mass + change;
    return term + change * (as_number<S>(T(1)) / mass);
}

// Gradients at the momentum of a term and, so far, at the mass, from those at the node's momentum, at the next term, and
// from what came back of the latter.
template <class T>
Quad<T> term_gradient(const Quad<T>& node, const Quad<T>& at_node, const Quad<T>& at_next, const Quad<T>& change,
                      const Quad<T>& term) {
    Quad<T> gradient = at_node + at_next;
    gradient[3] = at_next[3];
    if (!occupied<T>(node)) return gradient;
    for (int k = 0; k < 3; k++) {
        gradient[k] -= change[k] / node[3];
        gradient[3] += term[k] * (change[k] / node[3]);
    }
    return gradient;
}

// Momentum that a particle returns to the grid from the velocities that it got there, as vectors of scatter().
template <class S>
void returned(const Stencils<S>& stencils, int l, const Quad<S> sums[4], typename Plain<S>::type mass,
              Quad<S> vectors[4]) {
    const S whole = as_number<S>(mass), four = as_number<S>(4 * mass);
    vectors[0] = sums[0] * whole;
    for (int j = 0; j < 3; j++) {
        vectors[1 + j] = (sums[1 + j] - sums[0] * stencils.from_middle[j][l]) * four;
        vectors[0] = vectors[0] - vectors[1 + j] * stencils.from_middle[j][l];
    }
}

}  // namespace pcnclaws
