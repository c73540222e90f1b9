// One MLS-MPM step from particles to grid and back, its adjoint and its directional derivative: the same step as
// pcnclaws/mpm/integrator.py, which states the method and its sources.
#pragma once
#include "scene_grids.hpp"

namespace pcnclaws {

template <class S> class Step {
  public:
    typedef typename Plain<S>::type T;

    Step(const Settings& settings, const Bodies<T>& bodies, const State<S>& before, const Field<S>& stress, int threads,
         bool shared = false)
        : settings(settings),
          bodies(bodies),
          before(before),
          threads(threads),
          exchange(settings, bodies, before, stress),
          grids(settings, bodies, before.position, threads, shared) {}

    ~Step() {
        for (int which = 0; which < SCRATCH; which++)
            if (scratch(which).capacity() * sizeof(Quad<S>) > MOST_KEPT) Nodes().swap(scratch(which));
    }

    void forward(const State<S>& after) {
        move();
        each_part([&](const Part& part) { gather_state(part, moved.data(), after); });
    }

    // gradients of the state before and of the stress from those of the state after; for S = T
    void adjoint(const Moved<T>& after, const State<S>& incoming, const State<S>& gradient,
                 const Field<S>& stress_gradient) {
        move();
        node_gradient.resize(nodes.size());
        scatter_gradient(incoming);
        each_slab([&](int64_t scene, int x) {
            sum_tasks(scene, x, node_gradient.data());
            adjoint_nodes(scene, x);
        });
        gather_all(moved.data(), node_gradient.data(), after, incoming, gradient, stress_gradient);
    }

    // What follows is a step whose work on the grid is done by others, between the two: all scenes have the same nodes.

    // momentum and mass of all nodes
    void to_grid(Quad<S>* out) {
        scatter_state();
        each_slab([&](int64_t scene, int x) {
            sum_tasks(scene, x, out);
            if (settings.order > 1) begin_terms(scene, x, out);
        });
        add_terms(out, [](int64_t, int) {});
    }

    void from_grid(const Quad<S>* velocities, const State<S>& after) {
        each_part([&](const Part& part) { gather_state(part, velocities, after); });
    }

    // gradients at the velocities of the nodes, for S = T
    void to_node_velocities(const State<S>& incoming, Quad<S>* out) {
        scatter_gradient(incoming);
        each_slab([&](int64_t scene, int x) { sum_tasks(scene, x, out); });
    }

    // gradients of the state before and of the stress from those at momentum and mass of the nodes, for S = T
    void gather_gradient(const Quad<S>* velocities, const Quad<S>* gradients, const Moved<T>& after,
                         const State<S>& incoming, const State<S>& gradient, const Field<S>& stress_gradient) {
        if (settings.order > 1) {
            nodes.resize(grids.scene_nodes);
            to_grid(nodes.data());
        }
        gather_all(velocities, gradients, after, incoming, gradient, stress_gradient);
    }

  private:
    const Settings& settings;
    const Bodies<T>& bodies;
    const State<S>& before;
    const int threads;
    const Exchange<S> exchange;
    const SceneGrids<S> grids;
    typedef std::vector<Quad<S>> Nodes;
    // memory that is new costs more to touch than the work done in it: each thread keeps its own from step to step
    Nodes& tasks = scratch(0);  // what each part scatters
    Nodes& nodes = scratch(1);  // momentum and mass, of each scene
    Nodes& moved = scratch(2);  // velocity after gravity and walls
    Nodes& node_gradient = scratch(3);
    Nodes& change = scratch(4);                               // what came back of a term
    Nodes* const terms = &scratch(5);                         // of affine XPIC
    Nodes* const term_gradients = &scratch(5 + MOST_RETURNS);  // at their momenta
    static constexpr int SCRATCH = 5 + 2 * MOST_RETURNS;
    static Nodes& scratch(int which) {
        static thread_local Nodes memory[SCRATCH];
        return memory[which];
    }
    static constexpr size_t MOST_KEPT = size_t(1) << 28;  // bytes

    template <class Visit> void each_part(Visit visit) {
        parallel_for(int64_t(grids.parts.size()), threads, [&](int64_t k) { visit(grids.parts[k]); });
    }
    template <class Visit> void each_slab(Visit visit) {
        parallel_for(int64_t(grids.slabs.size()), threads,
                     [&](int64_t k) { visit(grids.slabs[k].first, grids.slabs[k].second); });
    }

    template <class Visit> void each_block(const Part& part, Visit visit) const {
        Stencils<S> stencils;
        for (int64_t first = part.first; first < part.last; first += LANE) {
            const int count = int(std::min<int64_t>(LANE, part.last - first));
            stencils.find(settings, before.position, bodies.particles, first, count);
            visit(stencils, first, count);
        }
    }

    void scatter_state() {
        tasks.resize(grids.task_nodes);
        if (settings.order > 1) change.resize(grids.scene_nodes);
        for (int64_t k = 0; k + 1 < settings.order; k++) terms[k].resize(grids.scene_nodes);
        each_part([&](const Part& part) {
            Quad<S>* memory = tasks.data() + part.memory;
            std::memset(static_cast<void*>(memory), 0, part.box.size() * sizeof(Quad<S>));
            each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
                Quad<S> vectors[LANE][4];
                for (int l = 0; l < count; l++) exchange.momentum(first + l, stencils, l, vectors[l]);
                for (int l = 0; l < count; l++) scatter(stencils, l, vectors[l], part.box, memory);
            });
        });
    }

    void move() {
        nodes.resize(grids.scene_nodes);
        moved.resize(grids.scene_nodes);
        scatter_state();
        each_slab([&](int64_t scene, int x) {
            sum_tasks(scene, x, nodes.data());
            if (settings.order > 1)
                begin_terms(scene, x, nodes.data());
            else
                move_nodes(scene, x);
        });
        add_terms(nodes.data(), [&](int64_t scene, int x) { move_nodes(scene, x); });
    }

    // What follows is affine XPIC.

    void begin_terms(int64_t scene, int x, const Quad<S>* from) {
        each_node(scene, x, [&](size_t at, const int*) { terms[0][at] = first_term<S>(from[at]); });
    }

    // Adds all terms after the first to the momenta of the nodes, and runs then(scene, x) on each slab.
    template <class Then> void add_terms(Quad<S>* to, Then then) {
        for (int64_t k = 1; k < settings.order; k++) {
            const bool last = k + 1 == settings.order;
            return_term(terms[k - 1].data(), last ? LAST_TERM : TERM, [&](int64_t scene, int x) {
                each_node(scene, x, [&](size_t at, const int*) {
                    const Quad<S> next = next_term<S>(to[at], terms[k - 1][at], change[at]);
                    if (!last) terms[k][at] = next;
                });
                if (last) then(scene, x);
            });
        }
    }

    // Sums what the particles return of a term into `change`, and runs then(scene, x) on each slab.
    template <class Then> void return_term(const Quad<S>* from, Return what, Then then) {
        each_part([&](const Part& piece) {
            const Box& box = grids.boxes[piece.scene];
            Quad<S>* memory = tasks.data() + piece.memory;
            std::memset(static_cast<void*>(memory), 0, piece.box.size() * sizeof(Quad<S>));
            each_block(piece, [&](const Stencils<S>& stencils, int64_t first, int count) {
                for (int l = 0; l < count; l++) {
                    Quad<S> vectors[4];
                    exchange.returned_term(first + l, stencils, l, box, from + grids.node_memory[piece.scene], what,
                                           vectors);
                    scatter(stencils, l, vectors, piece.box, memory);
                }
            });
        });
        each_slab([&](int64_t scene, int x) {
            sum_tasks(scene, x, change.data());
            then(scene, x);
        });
    }

    // Gradients at the momenta of all terms, and at the masses, from those at the momenta and masses of the nodes.
    void adjoint_terms(const Quad<S>* gradients) {
        const Quad<S>* next = gradients;
        for (int64_t k = settings.order - 2; k >= 0; k--) {
            term_gradients[k].resize(grids.scene_nodes);
            return_term(next, ADJOINT, [&](int64_t scene, int x) {
                each_node(scene, x, [&](size_t at, const int*) {
                    term_gradients[k][at] =
                        term_gradient<T>(nodes[at], gradients[at], next[at], change[at], terms[k][at]);
                });
            });
            next = term_gradients[k].data();
        }
    }

    void gather_all(const Quad<S>* velocities, const Quad<S>* gradients, const Moved<T>& after,
                    const State<S>& incoming, const State<S>& gradient, const Field<S>& stress_gradient) {
        adjoint_terms(gradients);
        Terms<S> all{settings.order - 1, {}, {}};
        for (int64_t k = 0; k < all.count; k++) {
            all.velocity[k] = terms[k].data();
            all.gradient[k] = k + 1 < all.count ? term_gradients[k + 1].data() : gradients;
        }
        const Quad<S>* of_first = all.count ? term_gradients[0].data() : gradients;
        each_part([&](const Part& piece) {
            gather_gradient(piece, velocities, of_first, all, after, incoming, gradient, stress_gradient);
        });
    }

    // What follows is APIC again.

    // One slab of a scene's nodes from what its parts scattered, in the order of the parts.
    void sum_tasks(int64_t scene, int x, Quad<S>* to) const {
        const Box& box = grids.boxes[scene];
        Quad<S>* slab = to + grids.node_memory[scene] + box.index(x, box.low[1], box.low[2]);
        std::memset(static_cast<void*>(slab), 0, sizeof(Quad<S>) * box.edge(1) * box.edge(2));
        for (int64_t k = grids.parts_of[scene].first; k < grids.parts_of[scene].second; k++) {
            const Part& part = grids.parts[k];
            if (x < part.box.low[0] || x > part.box.high[0]) continue;
            for (int y = part.box.low[1]; y <= part.box.high[1]; y++) {
                const Quad<S>* from = tasks.data() + part.memory + part.box.index(x, y, part.box.low[2]);
                Quad<S>* row = slab + size_t(y - box.low[1]) * box.edge(2) + (part.box.low[2] - box.low[2]);
                for (int z = 0; z < part.box.edge(2); z++) row[z] += from[z];
            }
        }
    }

    template <class Visit> void each_node(int64_t scene, int x, Visit visit) const {
        const Box& box = grids.boxes[scene];
        size_t at = grids.node_memory[scene] + box.index(x, box.low[1], box.low[2]);
        const unsigned char* of_z = settings.walls_of(2);
        int walls[3] = {settings.wall_at(0, x), 0, 0};
        for (int y = box.low[1]; y <= box.high[1]; y++) {
            walls[1] = settings.wall_at(1, y);
            for (int z = box.low[2]; z <= box.high[2]; z++, at++) {
                walls[2] = of_z ? of_z[z - settings.grid.low[2]] : 0;
                visit(at, walls);
            }
        }
    }

    void move_nodes(int64_t scene, int x) {
        const Quad<T> fall = exchange.fall_of(scene);
        each_node(scene, x, [&](size_t at, const int walls[3]) {
            moved[at] = exchange.moved_node(nodes[at], fall, walls);
        });
    }

    void gather_state(const Part& part, const Quad<S>* velocities, const State<S>& after) const {
        const Box& box = grids.boxes[part.scene];
        const Quad<S>* from = velocities + grids.node_memory[part.scene];
        each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
            exchange.gather_state(stencils, first, count, box, from, after);
        });
    }

    void scatter_gradient(const State<S>& incoming) {
        tasks.resize(grids.task_nodes);
        each_part([&](const Part& part) { scatter_gradient(part, incoming); });
    }

    void scatter_gradient(const Part& part, const State<S>& incoming) {
        Quad<S>* memory = tasks.data() + part.memory;
        std::memset(static_cast<void*>(memory), 0, part.box.size() * sizeof(Quad<S>));
        each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
            for (int l = 0; l < count; l++) {
                Quad<S> vectors[4];
                exchange.gradient_vectors(first + l, incoming, stencils, l, vectors);
                scatter(stencils, l, vectors, part.box, memory);
            }
        });
    }

    // Gradients at momentum and mass of the nodes, from those at their velocities.
    void adjoint_nodes(int64_t scene, int x) {
        const Quad<T> fall = exchange.fall_of(scene);
        each_node(scene, x, [&](size_t at, const int walls[3]) {
            node_gradient[at] = exchange.node_gradient(nodes[at], node_gradient[at], fall, walls);
        });
    }

    void gather_gradient(const Part& piece, const Quad<S>* velocities, const Quad<S>* gradients, Terms<S> all,
                         const Moved<T>& after, const State<S>& incoming, const State<S>& gradient,
                         const Field<S>& stress_gradient) const {
        const Box& box = grids.boxes[piece.scene];
        const size_t begin = grids.node_memory[piece.scene];
        velocities += begin;
        gradients += begin;
        for (int64_t k = 0; k < all.count; k++) {
            all.velocity[k] += begin;
            all.gradient[k] += begin;
        }
        each_block(piece, [&](const Stencils<S>& stencils, int64_t first, int count) {
            for (int l = 0; l < count; l++)
                exchange.gather_gradient(stencils, first + l, l, box, velocities, gradients, all, after, incoming,
                                         gradient, stress_gradient);
        });
    }
};

}  // namespace pcnclaws
