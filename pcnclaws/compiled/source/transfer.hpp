// One MLS-MPM step from particles to grid and back, its adjoint and its directional derivative: the same step as
// pcnclaws/mpm/integrator.py, which states the method and its sources.
#pragma once
#include <cmath>

#include "scene_grids.hpp"

namespace pcnclaws {

template <class S> class Step {
  public:
    typedef typename Plain<S>::type T;

    Step(const Settings& settings, const Bodies<T>& bodies, const State<S>& before, const Field<S>& stress, int threads)
        : settings(settings),
          bodies(bodies),
          before(before),
          stress(stress),
          threads(threads),
          spacing(T(1) / T(settings.nodes)),
          grids(settings, bodies, before.position, threads) {
        nodes.resize(grids.scene_nodes);
        moved.resize(grids.scene_nodes);
    }

    ~Step() {
        for (int which = 0; which < 4; which++)
            if (scratch(which).capacity() * sizeof(Quad<S>) > MOST_KEPT) Nodes().swap(scratch(which));
    }

    void forward(const State<S>& after) {
        scatter_state();
        each_part([&](const Part& part) { gather_state(part, after); });
    }

    // what the forward step gave
    struct Moved {
        const T *velocity, *affine;
    };

    // gradients of the state before and of the stress from those of the state after; for S = T
    void adjoint(const Moved& after, const State<S>& incoming, const State<S>& gradient,
                 const Field<S>& stress_gradient) {
        scatter_state();
        each_part([&](const Part& part) { scatter_gradient(part, incoming); });
        node_gradient.resize(nodes.size());
        each_slab([&](int64_t scene, int x) { adjoint_nodes(scene, x); });
        each_part([&](const Part& part) { gather_gradient(part, after, incoming, gradient, stress_gradient); });
    }

  private:
    const Settings& settings;
    const Bodies<T>& bodies;
    const State<S>& before;
    const Field<S>& stress;
    const int threads;
    const T spacing;
    const SceneGrids<S> grids;
    typedef std::vector<Quad<S>> Nodes;
    // memory that is new costs more to touch than the work done in it: each thread keeps its own from step to step
    Nodes& tasks = scratch(0);  // what each part scatters
    Nodes& nodes = scratch(1);  // momentum and mass, of each scene
    Nodes& moved = scratch(2);  // velocity after gravity and walls
    Nodes& node_gradient = scratch(3);
    static Nodes& scratch(int which) {
        static thread_local Nodes memory[4];
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

    // Momentum at a node of the stencil is q + i A_x + j A_y + k A_z: four vectors, the last component of the first the
    // mass.
    void momentum(int64_t p, const Stencils<S>& stencils, int l, Quad<S> vectors[4]) const {
        const int64_t n = bodies.particles;
        const T mass = bodies.mass[p], pull = T(settings.time_step) * 4 / (spacing * spacing) * bodies.volume[p];
        S step[3][3], q[3];
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++)
                step[i][j] = scaled(spacing, scaled(mass, before.affine.get((3 * i + j) * n + p)) -
                                                 scaled(pull, stress.get((3 * i + j) * n + p)));
            q[i] = scaled(mass, before.velocity.get(i * n + p));
            for (int j = 0; j < 3; j++) q[i] = q[i] - step[i][j] * stencils.from_middle[j][l];
        }
        S m{}, zero{};
        Stencils<S>::subtract(m, -mass);
        vectors[0] = quad(q[0], q[1], q[2], m);
        for (int j = 0; j < 3; j++) vectors[1 + j] = quad(step[0][j], step[1][j], step[2][j], zero);
    }

    template <class Visit> void each_block(const Part& part, Visit visit) const {
        Stencils<S> stencils;
        for (int64_t first = part.first; first < part.last; first += LANE) {
            const int count = int(std::min<int64_t>(LANE, part.last - first));
            stencils.find(before.position, bodies.particles, first, count, T(settings.nodes));
            visit(stencils, first, count);
        }
    }

    void scatter_state() {
        tasks.resize(grids.task_nodes);
        each_part([&](const Part& part) {
            Quad<S>* memory = tasks.data() + part.memory;
            std::memset(static_cast<void*>(memory), 0, part.box.size() * sizeof(Quad<S>));
            each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
                Quad<S> vectors[LANE][4];
                for (int l = 0; l < count; l++) momentum(first + l, stencils, l, vectors[l]);
                for (int l = 0; l < count; l++) scatter(stencils, l, vectors[l], part.box, memory);
            });
        });
        each_slab([&](int64_t scene, int x) {
            sum_tasks(scene, x, nodes.data());
            move_nodes(scene, x);
        });
    }

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

    // Which components of the velocity a node loses: bit k for component k.
    int lost(const Quad<S>& velocity, int walls_x, int walls_y, int walls_z) const {
        const int walls[3] = {walls_x, walls_y, walls_z};
        int into = 0;
        for (int k = 0; k < 3; k++) {
            const T v = value_of(component(velocity, k));
            if ((walls[k] & 1 && v < 0) || (walls[k] & 2 && v > 0)) into |= 1 << k;
        }
        return settings.stick && into ? 7 : into;
    }

    template <class Visit> void each_node(int64_t scene, int x, Visit visit) const {
        const Box& box = grids.boxes[scene];
        size_t at = grids.node_memory[scene] + box.index(x, box.low[1], box.low[2]);
        for (int y = box.low[1]; y <= box.high[1]; y++)
            for (int z = box.low[2]; z <= box.high[2]; z++, at++)
                visit(at, settings.walls[x + 1], settings.walls[y + 1], settings.walls[z + 1]);
    }

    // Masses so small that a division by them could overflow in the adjoint count as none.
    static bool occupied(const Quad<S>& node) {
        return value_of(component(node, 3)) > std::numeric_limits<T>::min() * T(1e3);
    }

    Quad<S> velocity_at(const Quad<S>& node, Quad<T> fall) const {
        const S mass = component(node, 3);
        S one{};
        Stencils<S>::subtract(one, T(-1));
        Quad<S> velocity = node * (one / mass);
        add(velocity, fall);
        return velocity;
    }
    static void add(Quad<T>& a, Quad<T> b) { a += b; }
    static void add(Rate<Quad<T>>& a, Quad<T> b) { a.value += b; }

    Quad<T> fall_of(int64_t scene) const {
        const T dt = T(settings.time_step);
        const T* g = bodies.gravity + scene;
        return Quad<T>{dt * g[0], dt * g[bodies.scenes], dt * g[2 * bodies.scenes], T(0)};
    }

    void move_nodes(int64_t scene, int x) {
        const Quad<T> fall = fall_of(scene);
        each_node(scene, x, [&](size_t at, int walls_x, int walls_y, int walls_z) {
            moved[at] = Quad<S>{};
            if (!occupied(nodes[at])) return;
            Quad<S> velocity = velocity_at(nodes[at], fall);
            if (walls_x | walls_y | walls_z) {
                const int into = lost(velocity, walls_x, walls_y, walls_z);
                for (int k = 0; k < 3; k++)
                    if (into >> k & 1) set_component(velocity, k, S{});
            }
            moved[at] = velocity;
        });
    }

    void gather_state(const Part& part, const State<S>& after) const {
        const Box& box = grids.boxes[part.scene];
        const Quad<S>* from = moved.data() + grids.node_memory[part.scene];
        const int64_t n = bodies.particles;
        const T dt = T(settings.time_step);
        each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
            S sums[4][3][LANE];
            for (int l = 0; l < count; l++) {
                Quad<S> quads[4];
                gather(stencils, l, box, from, quads);
                for (int k = 0; k < 4; k++)
                    for (int i = 0; i < 3; i++) sums[k][i][l] = component(quads[k], i);
            }
            for (int i = 0; i < 3; i++)
                for (int l = 0; l < count; l++) {
                    const S v = sums[0][i][l];
                    after.velocity.set(i * n + first + l, v);
                    after.position.set(i * n + first + l, before.position.get(i * n + first + l) + scaled(dt, v));
                }
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    for (int l = 0; l < count; l++) {
                        const S c = scaled(4 / spacing, sums[1 + j][i][l] - sums[0][i][l] * stencils.from_middle[j][l]);
                        sums[1 + j][i][l] = c;
                        after.affine.set((3 * i + j) * n + first + l, c);
                    }
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++)
                    for (int l = 0; l < count; l++) {
                        S f = before.deformation.get((3 * i + j) * n + first + l);
                        S change = sums[1][i][l] * before.deformation.get(j * n + first + l);
                        change += sums[2][i][l] * before.deformation.get((3 + j) * n + first + l);
                        change += sums[3][i][l] * before.deformation.get((6 + j) * n + first + l);
                        after.deformation.set((3 * i + j) * n + first + l, f + scaled(dt, change));
                    }
        });
    }

    // Gradients at the particle's velocity and affine velocity, the uses of them in x and F included.
    struct Incoming {
        T velocity[3], affine[3][3];
    };
    Incoming incoming_of(const State<S>& incoming, int64_t p) const {
        const int64_t n = bodies.particles;
        const T dt = T(settings.time_step);
        Incoming out;
        for (int i = 0; i < 3; i++) {
            out.velocity[i] = incoming.velocity.get(i * n + p) + dt * incoming.position.get(i * n + p);
            for (int j = 0; j < 3; j++) {
                T sum = 0;
                for (int k = 0; k < 3; k++)
                    sum += incoming.deformation.get((3 * i + k) * n + p) * before.deformation.get((3 * j + k) * n + p);
                out.affine[i][j] = incoming.affine.get((3 * i + j) * n + p) + dt * sum;
            }
        }
        return out;
    }
    // The gradient at a node's velocity is w (a + i b_x + j b_y + k b_z).
    void gradient_vectors(const Incoming& in, const Stencils<S>& stencils, int l, Quad<S> vectors[4]) const {
        T a[3], b[3][3];
        for (int i = 0; i < 3; i++) {
            a[i] = in.velocity[i];
            for (int j = 0; j < 3; j++) {
                b[i][j] = 4 / spacing * in.affine[i][j];
                a[i] -= b[i][j] * stencils.from_middle[j][l];
            }
        }
        vectors[0] = quad(a[0], a[1], a[2], T(0));
        for (int j = 0; j < 3; j++) vectors[1 + j] = quad(b[0][j], b[1][j], b[2][j], T(0));
    }

    void scatter_gradient(const Part& part, const State<S>& incoming) {
        Quad<S>* memory = tasks.data() + part.memory;
        std::memset(static_cast<void*>(memory), 0, part.box.size() * sizeof(Quad<S>));
        each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
            for (int l = 0; l < count; l++) {
                Quad<S> vectors[4];
                gradient_vectors(incoming_of(incoming, first + l), stencils, l, vectors);
                scatter(stencils, l, vectors, part.box, memory);
            }
        });
    }

    // Gradients at momentum and mass of the nodes, from those at their velocities.
    void adjoint_nodes(int64_t scene, int x) {
        sum_tasks(scene, x, node_gradient.data());
        const Quad<T> fall = fall_of(scene);
        each_node(scene, x, [&](size_t at, int walls_x, int walls_y, int walls_z) {
            Quad<S> g = node_gradient[at];
            node_gradient[at] = Quad<S>{};
            if (!occupied(nodes[at])) return;
            const T mass = component(nodes[at], 3);
            const int into = lost(velocity_at(nodes[at], fall), walls_x, walls_y, walls_z);
            T of_mass = 0;
            for (int k = 0; k < 3; k++) {
                const T of_momentum = into >> k & 1 ? T(0) : g[k] / mass;
                g[k] = of_momentum;
                of_mass -= of_momentum * (nodes[at][k] / mass);
            }
            g[3] = of_mass;
            node_gradient[at] = g;
        });
    }

    void gather_gradient(const Part& part, const Moved& after, const State<S>& incoming, const State<S>& gradient,
                         const Field<S>& stress_gradient) const {
        const Box& box = grids.boxes[part.scene];
        const Quad<S>* velocities = moved.data() + grids.node_memory[part.scene];
        const Quad<S>* gradients = node_gradient.data() + grids.node_memory[part.scene];
        const int64_t n = bodies.particles;
        const T dt = T(settings.time_step);
        each_block(part, [&](const Stencils<S>& stencils, int64_t first, int count) {
            for (int l = 0; l < count; l++) {
                const int64_t p = first + l;
                const Incoming in = incoming_of(incoming, p);
                Quad<S> back[4], forth[4], sums[4];
                gradient_vectors(in, stencils, l, back);
                momentum(p, stencils, l, forth);
                gather(stencils, l, box, gradients, sums);
                T d[3];
                weight_gradient(stencils, l, box, velocities, gradients, back, forth, d);
                const T mass = bodies.mass[p], pull = dt * 4 / (spacing * spacing) * bodies.volume[p];
                for (int j = 0; j < 3; j++)
                    for (int i = 0; i < 3; i++) {
                        // d enters C = 4/dx (M - v d^T) and q = m v - A d as well
                        d[j] -=
                            4 / spacing * in.affine[i][j] * after.velocity[i * n + p] + forth[1 + j][i] * sums[0][i];
                        const T of_affine = spacing * (sums[1 + j][i] - sums[0][i] * stencils.from_middle[j][l]);
                        gradient.affine.set((3 * i + j) * n + p, mass * of_affine);
                        stress_gradient.set((3 * i + j) * n + p, -pull * of_affine);
                        T of_deformation = incoming.deformation.get((3 * i + j) * n + p);
                        for (int k = 0; k < 3; k++)
                            of_deformation +=
                                dt * after.affine[(3 * k + i) * n + p] * incoming.deformation.get((3 * k + j) * n + p);
                        gradient.deformation.set((3 * i + j) * n + p, of_deformation);
                    }
                for (int i = 0; i < 3; i++) {
                    gradient.velocity.set(i * n + p, mass * sums[0][i]);
                    gradient.position.set(i * n + p, incoming.position.get(i * n + p) + d[i] / spacing);
                }
            }
        });
    }
};

}  // namespace pcnclaws
