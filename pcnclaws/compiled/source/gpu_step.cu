// The kernels of a step on a GPU, a thread for every particle or node. NUMBER is the type of the state.
#include "exchange.hpp"
#include "failing.hpp"
#include "threads.hpp"

using namespace pcnclaws;
using T = NUMBER;

// Addresses of the fields of a state, or of their gradients; of the stress where there is one.
struct Fields {
    T *position, *velocity, *affine, *deformation, *stress;
    State<T> state() const { return {{position}, {velocity}, {affine}, {deformation}}; }
};

namespace {

// Where the nodes of a particle's scene begin.
int64_t first_node(const Bodies<T>& bodies, int64_t p, const Box& box) {
    const int64_t scene = bodies.scene[p];
    if (scene < 0 || scene >= bodies.scenes) stop();
    return scene * int64_t(box.size());
}

// Runs visit(exchange, stencils, particle, box, first node of its scene).
template <class Visit>
void with_particle(const Settings& settings, const Bodies<T>& bodies, const Fields& before, Visit visit) {
    const int64_t p = thread_number();
    if (p >= bodies.particles) return;
    const State<T> state = before.state();
    const Field<T> stress{before.stress};
    const Exchange<T> exchange(settings, bodies, state, stress);
    const Box box = settings.grid;
    Stencils<T> stencils;
    stencils.find(settings, state.position, bodies.particles, p, 1);
    visit(exchange, stencils, p, box, first_node(bodies, p, box));
}

// Runs visit(exchange, node, walls at it, what falling adds to its velocity).
template <class Visit> void with_node(const Settings& settings, const Bodies<T>& bodies, Visit visit) {
    const Box box = settings.grid;
    const int64_t node = thread_number(), size = int64_t(box.size());
    if (node >= bodies.scenes * size) return;
    const State<T> none{};
    const Field<T> no_stress{};
    const Exchange<T> exchange(settings, bodies, none, no_stress);
    const int64_t within = node % size, rows = within / box.edge(2);
    const int walls[3] = {settings.wall_at(0, box.low[0] + int(rows / box.edge(1))),
                          settings.wall_at(1, box.low[1] + int(rows % box.edge(1))),
                          settings.wall_at(2, box.low[2] + int(within % box.edge(2)))};
    visit(exchange, node, walls, exchange.fall_of(node / size));
}

}  // namespace

// nodes: momentum and mass, 0 before
KERNEL(scatter_state)(Settings settings, Bodies<T> bodies, Fields before, Quad<T>* nodes) {
    with_particle(settings, bodies, before, [&](auto& exchange, auto& stencils, int64_t p, auto& box, int64_t first) {
        Quad<T> vectors[4];
        exchange.momentum(p, stencils, 0, vectors);
        scatter(stencils, 0, vectors, box, nodes + first);
    });
}

// For affine XPIC: term: the first one
KERNEL(begin_terms)(Settings settings, Bodies<T> bodies, const Quad<T>* nodes, Quad<T>* term) {
    with_node(settings, bodies, [&](auto&, int64_t node, const int*, Quad<T>) {
        term[node] = first_term<T>(nodes[node]);
    });
}

// change: what comes back of what the particles get `from` nodes, 0 before; what: a Return
KERNEL(return_term)
(Settings settings, Bodies<T> bodies, Fields before, const Quad<T>* from, int64_t what, Quad<T>* change) {
    with_particle(settings, bodies, before, [&](auto& exchange, auto& stencils, int64_t p, auto& box, int64_t first) {
        Quad<T> vectors[4];
        exchange.returned_term(p, stencils, 0, box, from + first, Return(what), vectors);
        scatter(stencils, 0, vectors, box, change + first);
    });
}

// next: null after the last one
KERNEL(add_term)
(Settings settings, Bodies<T> bodies, Quad<T>* nodes, const Quad<T>* term, const Quad<T>* change, Quad<T>* next) {
    with_node(settings, bodies, [&](auto&, int64_t node, const int*, Quad<T>) {
        const Quad<T> found = next_term<T>(nodes[node], term[node], change[node]);
        if (next) next[node] = found;
    });
}

KERNEL(find_term_gradient)
(Settings settings, Bodies<T> bodies, const Quad<T>* nodes, const Quad<T>* gradients, const Quad<T>* of_next,
 const Quad<T>* change, const Quad<T>* term, Quad<T>* found) {
    with_node(settings, bodies, [&](auto&, int64_t node, const int*, Quad<T>) {
        found[node] = term_gradient<T>(nodes[node], gradients[node], of_next[node], change[node], term[node]);
    });
}

KERNEL(move_nodes)(Settings settings, Bodies<T> bodies, const Quad<T>* nodes, Quad<T>* moved) {
    with_node(settings, bodies, [&](auto& exchange, int64_t node, const int walls[3], Quad<T> fall) {
        moved[node] = exchange.moved_node(nodes[node], fall, walls);
    });
}

KERNEL(gather_state)(Settings settings, Bodies<T> bodies, Fields before, const Quad<T>* moved, Fields after) {
    with_particle(settings, bodies, before, [&](auto& exchange, auto& stencils, int64_t p, auto& box, int64_t first) {
        exchange.gather_state(stencils, p, 1, box, moved + first, after.state());
    });
}

// node_gradients: at the velocities of the nodes, 0 before
KERNEL(scatter_gradient)
(Settings settings, Bodies<T> bodies, Fields before, Fields incoming, Quad<T>* node_gradients) {
    with_particle(settings, bodies, before, [&](auto& exchange, auto& stencils, int64_t p, auto& box, int64_t first) {
        Quad<T> vectors[4];
        exchange.gradient_vectors(p, incoming.state(), stencils, 0, vectors);
        scatter(stencils, 0, vectors, box, node_gradients + first);
    });
}

// node_gradients: then at momentum and mass
KERNEL(adjoint_nodes)(Settings settings, Bodies<T> bodies, const Quad<T>* nodes, Quad<T>* node_gradients) {
    with_node(settings, bodies, [&](auto& exchange, int64_t node, const int walls[3], Quad<T> fall) {
        node_gradients[node] = exchange.node_gradient(nodes[node], node_gradients[node], fall, walls);
    });
}

KERNEL(gather_gradient)
(Settings settings, Bodies<T> bodies, Fields before, Moved<T> after, Fields incoming, const Quad<T>* moved,
 const Quad<T>* node_gradients, Fields gradient, Terms<T> terms) {
    with_particle(settings, bodies, before, [&](auto& exchange, auto& stencils, int64_t p, auto& box, int64_t first) {
        for (int64_t k = 0; k < terms.count; k++) {
            terms.velocity[k] += first;
            terms.gradient[k] += first;
        }
        exchange.gather_gradient(stencils, p, 0, box, moved + first, node_gradients + first, terms, after,
                                 incoming.state(), gradient.state(), {gradient.stress});
    });
}

KERNEL(find_failing)(int64_t particles, Corners domain, const T* position, const T* deformation, bool* failed) {
    const int64_t p = thread_number();
    if (p < particles) failed[p] = fails(particles, domain, position, deformation, p);
}
