// What one particle and one node do in a step and in its adjoint: the same for the tasks of a CPU (transfer.hpp) and the
// threads of a GPU (gpu_step.cu). The method and its sources are stated in pcnclaws/mpm/integrator.py.
#pragma once
#include "terms.hpp"

namespace pcnclaws {

// Contacts of walls, in the order of WALL_CONTACTS in pcnclaws/mpm/integrator.py.
enum Contact { SEPARATE, VERSION_1_STICK, SLIP, STICKY };

template <class S> struct State {
    Field<S> position, velocity, affine, deformation;
};

template <class T> struct Bodies {
    int64_t particles, scenes;
    const int64_t* scene;  // scene of each particle, not decreasing
    const T *mass, *volume, *gravity;
};

// What the forward step gave.
template <class T> struct Moved {
    const T *velocity, *affine;
};

template <class S> class Exchange {
  public:
    typedef typename Plain<S>::type T;

    Exchange(const Settings& settings, const Bodies<T>& bodies, const State<S>& before, const Field<S>& stress)
        : settings(settings), bodies(bodies), before(before), stress(stress), spacing(T(1) / T(settings.per_metre)) {}

    // Momentum at a node of the stencil is q + i A_x + j A_y + k A_z: four vectors, the last component of the first the
    // mass. The stress is in it in APIC alone.
    void momentum(int64_t p, const Stencils<S>& stencils, int l, Quad<S> vectors[4]) const {
        const int64_t n = bodies.particles;
        const T mass = bodies.mass[p], pull = settings.order == 1 ? pull_of(p) : T(0);
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

    // What a particle returns to the grid of a term of affine XPIC.
    void returned_term(int64_t p, const Stencils<S>& stencils, int l, const Box& box, const Quad<S>* from, Return what,
                       Quad<S> vectors[4]) const {
        Quad<S> sums[4];
        gather(stencils, l, box, from, sums);
        returned(stencils, l, sums, what == ADJOINT ? bodies.mass[p] : -bodies.mass[p], vectors);
        if (what == LAST_TERM) add_stress(p, stencils, l, vectors);
    }

    // The velocity of a node after gravity and walls, from its momentum and mass.
    Quad<S> moved_node(const Quad<S>& node, Quad<T> fall, const int walls[3]) const {
        if (!occupied<S>(node)) return Quad<S>{};
        Quad<S> velocity = velocity_at(node, fall);
        if (walls[0] | walls[1] | walls[2]) {
            const int into = lost(velocity, walls);
            for (int k = 0; k < 3; k++)
                if (into >> k & 1) set_component(velocity, k, S{});
        }
        return velocity;
    }

    // What a step of time adds to the velocity of a scene's nodes.
    Quad<T> fall_of(int64_t scene) const {
        const T dt = T(settings.time_step);
        const T* g = bodies.gravity + scene;
        return Quad<T>{dt * g[0], dt * g[bodies.scenes], dt * g[2 * bodies.scenes], T(0)};
    }

    // The state after the step of the particles from `first` on, from the velocities of their nodes.
    void gather_state(const Stencils<S>& stencils, int64_t first, int count, const Box& box, const Quad<S>* from,
                      const State<S>& after) const {
        const int64_t n = bodies.particles;
        const T dt = T(settings.time_step);
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
    }

    // What follows is the adjoint, for S = T.

    // The gradient at a node's velocity is w (a + i b_x + j b_y + k b_z), from the gradients of the state after.
    void gradient_vectors(int64_t p, const State<S>& incoming, const Stencils<S>& stencils, int l,
                          Quad<S> vectors[4]) const {
        gradient_vectors(incoming_of(incoming, p), stencils, l, vectors);
    }

    // Gradients at momentum and mass of a node, from those at its velocity.
    Quad<S> node_gradient(const Quad<S>& node, Quad<S> gradient, Quad<T> fall, const int walls[3]) const {
        if (!occupied<S>(node)) return Quad<S>{};
        const T mass = component(node, 3);
        const int into = lost(velocity_at(node, fall), walls);
        T of_mass = 0;
        for (int k = 0; k < 3; k++) {
            const T of_momentum = into >> k & 1 ? T(0) : gradient[k] / mass;
            gradient[k] = of_momentum;
            of_mass -= of_momentum * (node[k] / mass);
        }
        gradient[3] = of_mass;
        return gradient;
    }

    // Gradients of the state before a step and of the stress, of particle p. gradients: at momentum and mass, those of the
    // first term where there are terms
    void gather_gradient(const Stencils<S>& stencils, int64_t p, int l, const Box& box, const Quad<S>* velocities,
                         const Quad<S>* gradients, const Terms<S>& terms, const Moved<T>& after,
                         const State<S>& incoming, const State<S>& gradient, const Field<S>& stress_gradient) const {
        const int64_t n = bodies.particles;
        const T dt = T(settings.time_step);
        const Incoming in = incoming_of(incoming, p);
        Quad<S> back[4], forth[4], sums[4], of_last[4];
        gradient_vectors(in, stencils, l, back);
        momentum(p, stencils, l, forth);
        gather(stencils, l, box, gradients, sums);
        T d[3];
        weight_gradient(stencils, l, box, velocities, gradients, back, forth, d);
        if (terms.count) gather_terms(stencils, p, l, box, terms, d, of_last);
        const Quad<S>* pulled = terms.count ? of_last : sums;
        const T mass = bodies.mass[p], pull = pull_of(p);
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++) {
                // d enters C = 4/dx (M - v d^T) and q = m v - A d as well
                d[j] -= 4 / spacing * in.affine[i][j] * after.velocity[i * n + p] + forth[1 + j][i] * sums[0][i];
                gradient.affine.set((3 * i + j) * n + p, mass * of_affine(stencils, l, sums, i, j));
                stress_gradient.set((3 * i + j) * n + p, -pull * of_affine(stencils, l, pulled, i, j));
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

  private:
    const Settings& settings;
    const Bodies<T>& bodies;
    const State<S>& before;
    const Field<S>& stress;
    const T spacing;

    // What the stress of a particle takes from its affine momentum.
    T pull_of(int64_t p) const { return T(settings.time_step) * 4 / (spacing * spacing) * bodies.volume[p]; }

    void add_stress(int64_t p, const Stencils<S>& stencils, int l, Quad<S> vectors[4]) const {
        const int64_t n = bodies.particles;
        const T pull = -spacing * pull_of(p);
        for (int j = 0; j < 3; j++) {
            const Quad<S> step = quad(scaled(pull, stress.get(j * n + p)), scaled(pull, stress.get((3 + j) * n + p)),
                                      scaled(pull, stress.get((6 + j) * n + p)), S{});
            vectors[1 + j] = vectors[1 + j] + step;
            vectors[0] = vectors[0] - step * stencils.from_middle[j][l];
        }
    }

    // The gradient at an affine momentum, from what is gathered of those at the momenta of the nodes.
    T of_affine(const Stencils<S>& stencils, int l, const Quad<S> sums[4], int i, int j) const {
        return spacing * (sums[1 + j][i] - sums[0][i] * stencils.from_middle[j][l]);
    }

    // Adds to d what the terms make of a change of the weights.
    // of_last: what is gathered of the gradients at the last term
    void gather_terms(const Stencils<S>& stencils, int64_t p, int l, const Box& box, const Terms<S>& terms, T d[3],
                      Quad<S> of_last[4]) const {
        for (int64_t k = 0; k < terms.count; k++) {
            Quad<S> term[4], back[4], forth[4];
            T change[3];
            gather(stencils, l, box, terms.velocity[k], term);
            gather(stencils, l, box, terms.gradient[k], of_last);
            returned(stencils, l, of_last, -bodies.mass[p], back);
            returned(stencils, l, term, -bodies.mass[p], forth);
            if (k + 1 == terms.count) add_stress(p, stencils, l, forth);
            weight_gradient(stencils, l, box, terms.velocity[k], terms.gradient[k], back, forth, change);
            for (int j = 0; j < 3; j++) {
                d[j] += change[j];
                for (int i = 0; i < 3; i++) d[j] -= back[1 + j][i] * term[0][i] + forth[1 + j][i] * of_last[0][i];
            }
        }
    }

    Quad<S> velocity_at(const Quad<S>& node, Quad<T> fall) const {
        Quad<S> velocity = node * (as_number<S>(T(1)) / component(node, 3));
        add(velocity, fall);
        return velocity;
    }
    static void add(Quad<T>& a, Quad<T> b) { a += b; }
    static void add(Rate<Quad<T>>& a, Quad<T> b) { a.value += b; }

    // Which components of the velocity a node loses: bit k for component k.
    int lost(const Quad<S>& velocity, const int walls[3]) const {
        int into = 0;
        const bool always = settings.contact == SLIP || settings.contact == STICKY;
        for (int k = 0; k < 3; k++) {
            const T v = value_of(component(velocity, k));
            if ((walls[k] & 1 && (always || v < 0)) || (walls[k] & 2 && (always || v > 0))) into |= 1 << k;
        }
        return into && (settings.contact == VERSION_1_STICK || settings.contact == STICKY) ? 7 : into;
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
};

}  // namespace pcnclaws
