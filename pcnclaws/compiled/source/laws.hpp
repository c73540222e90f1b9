// The laws in principal space. Every law here is isotropic: it shares its principal axes with the strain, so that it is
// a function from three principal Hencky strains to three principal stresses, or to three changes of strain.
//
// The equations are those of pcnclaws/laws/*.py, which state their sources; the derivatives follow from running the
// same lines with dual numbers.
#pragma once
#include "functions.hpp"

namespace pcnclaws {

template <class S> S trace(const S h[3]) { return h[0] + h[1] + h[2]; }

template <class S> void deviator(const S h[3], S dev[3]) {
    const S mean = trace(h) / 3.0;
    for (int i = 0; i < 3; i++) dev[i] = h[i] - mean;
}

template <class S> S sum_of_squares(const S a[3]) { return square(a[0]) + square(a[1]) + square(a[2]); }

// What a law says about itself: RETURN_MAP or stress; PARAMETERS, the rows of per-particle parameters that `respond`
// reads (any further rows are inputs of its network); FEATURES x and OUTPUTS f of the network, 0 without one. The
// features are invariants of the strain: they do not change when two principal strains are exchanged.
struct Analytic {
    static constexpr int FEATURES = 0, OUTPUTS = 0;
    template <class S> static void features(const S*, S*) {}
};

struct FixedCorotated : Analytic {  // parameters: mu, lambda [Pa]
    static constexpr bool RETURN_MAP = false;
    static constexpr int PARAMETERS = 2;
    template <class S> static void respond(const S h[3], const S*, const S* p, const S*, S y[3]) {
        S s[3];
        for (int i = 0; i < 3; i++) s[i] = exponential(h[i]);
        const S j = s[0] * s[1] * s[2], pressure = p[1] * j * (j - 1.0);
        for (int i = 0; i < 3; i++) y[i] = 2.0 * p[0] * s[i] * (s[i] - 1.0) + pressure;
    }
};

struct NeoHookean : Analytic {  // parameters: mu, lambda [Pa]
    static constexpr bool RETURN_MAP = false;
    static constexpr int PARAMETERS = 2;
    template <class S> static void respond(const S h[3], const S*, const S* p, const S*, S y[3]) {
        const S pressure = p[1] * trace(h);
        for (int i = 0; i < 3; i++) y[i] = p[0] * (exponential(2.0 * h[i]) - 1.0) + pressure;
    }
};

struct StVKHencky : Analytic {  // parameters: mu, lambda [Pa]
    static constexpr bool RETURN_MAP = false;
    static constexpr int PARAMETERS = 2;
    template <class S> static void respond(const S h[3], const S*, const S* p, const S*, S y[3]) {
        const S pressure = p[1] * trace(h);
        for (int i = 0; i < 3; i++) y[i] = 2.0 * p[0] * h[i] + pressure;
    }
};

struct DruckerPrager : Analytic {  // parameter: slope of the yield surface, (3 lambda + 2 mu)/(2 mu) alpha
    static constexpr bool RETURN_MAP = true;
    static constexpr int PARAMETERS = 1;
    template <class S> static void respond(const S h[3], const S*, const S* p, const S*, S y[3]) {
        S dev[3];
        deviator(h, dev);
        const S volumetric = trace(h), shear = safe_root(sum_of_squares(dev));
        const S excess = shear + p[0] * volumetric, zero = constant(V{}, excess);
        const S share = select(
            value_of(shear) > 0.0,
            select(value_of(excess) > 0.0, excess, zero) / select(value_of(shear) > 0.0, shear, zero + 1.0), zero);
        for (int i = 0; i < 3; i++) y[i] = select(value_of(volumetric) > 0.0, -h[i], -(dev[i] * share));
    }
};

struct VonMises : Analytic {  // parameter: shear strain at yield, tau_Y/(2 mu)
    static constexpr bool RETURN_MAP = true;
    static constexpr int PARAMETERS = 1;
    template <class S> static void respond(const S h[3], const S*, const S* p, const S*, S y[3]) {
        S dev[3];
        deviator(h, dev);
        const S shear = safe_root(sum_of_squares(dev)), excess = shear - p[0], zero = constant(V{}, excess);
        const S share = select(value_of(excess) > 0.0, excess / select(value_of(shear) > 0.0, shear, zero + 1.0), zero);
        for (int i = 0; i < 3; i++) y[i] = -(dev[i] * share);
    }
};

struct Tresca : Analytic {  // parameter: largest difference of two principal strains, sqrt(2) tau_Y/(2 mu)
    static constexpr bool RETURN_MAP = true;
    static constexpr int PARAMETERS = 1;
    // Every value is held between the lowest and the highest that the middle one allows: no order is asked for.
    template <class S> static void respond(const S h[3], const S*, const S* p, const S*, S y[3]) {
        S dev[3];
        deviator(h, dev);
        const S third = p[0] / 3.0, larger = maximum(dev[0], dev[1]), smaller = minimum(dev[0], dev[1]);
        const S middle = held(maximum(smaller, minimum(larger, dev[2])), -third, third);
        const S highest = 0.5 * (p[0] - middle), lowest = -(0.5 * (p[0] + middle));
        for (int i = 0; i < 3; i++) y[i] = held(dev[i], lowest, highest) - dev[i];
    }
    template <class S> static S held(const S& x, const S& low, const S& high) {
        return maximum(minimum(x, high), low);
    }
};

constexpr double STRAIN_SCALE = 0.1, SOFTPLUS_ONE = 0.5413248546129181;

struct ElasticNet {  // parameters: mu, lambda [Pa]
    static constexpr bool RETURN_MAP = false;
    static constexpr int PARAMETERS = 2, FEATURES = 3, OUTPUTS = 6;
    template <class S> static void features(const S h[3], S x[3]) {
        S dev[3];
        deviator(h, dev);
        x[0] = trace(h) / STRAIN_SCALE;
        x[1] = sum_of_squares(dev) / (STRAIN_SCALE * STRAIN_SCALE);
        x[2] = dev[0] * dev[1] * dev[2] / (STRAIN_SCALE * STRAIN_SCALE * STRAIN_SCALE);
        for (int i = 0; i < 3; i++) x[i] = bounded(x[i]);
    }
    // x / sqrt(1 + x^2/100)
    template <class S> static S bounded(const S& x) {
        const V value = value_of(x), inverse = 1.0 / square_root(1.0 + value * value / 100.0);
        return chain(x, value * inverse, inverse * inverse * inverse);
    }
    // 1/(1 + 4 max(|h|^2 - 2, 0)^2)
    template <class S> static S familiarity(const S& squared) {
        const V beyond = maximum(value_of(squared) - 2.0, V{}), value = 1.0 / (1.0 + 4.0 * beyond * beyond);
        return chain(squared, value, -8.0 * beyond * value * value);
    }
    template <class S> static void respond(const S h[3], const S* x, const S* p, const S* f, S y[3]) {
        S dev[3];
        deviator(h, dev);
        const S shear_squared = sum_of_squares(dev), third = shear_squared / 3.0, two_mu = 2.0 * p[0];
        const S known = familiarity(sum_of_squares(h));
        const S g0 = softplus(known * (f[0] * x[0] + f[1] * x[1]) + SOFTPLUS_ONE);
        const S g1 = softplus(known * (f[2] * x[0] + f[3] * x[1]) + SOFTPLUS_ONE);
        const S pressure = (p[1] + two_mu / 3.0) * g0 * trace(h) + two_mu * known * f[5] * shear_squared;
        for (int i = 0; i < 3; i++) y[i] = two_mu * (g1 * dev[i] + known * f[4] * (square(dev[i]) - third)) + pressure;
    }
};

struct NoPriorElasticNet : ElasticNet {  // parameter: unit of stress [Pa]
    static constexpr int PARAMETERS = 1, OUTPUTS = 4;
    template <class S> static void respond(const S h[3], const S*, const S* p, const S* f, S y[3]) {
        S dev[3];
        deviator(h, dev);
        const S shear_squared = sum_of_squares(dev), third = shear_squared / 3.0;
        const S a0 = softplus(f[0] + SOFTPLUS_ONE), a1 = softplus(f[1] + SOFTPLUS_ONE);
        const S pressure = a0 * trace(h) + f[3] * shear_squared;
        for (int i = 0; i < 3; i++) y[i] = p[0] * (a1 * dev[i] + f[2] * (square(dev[i]) - third) + pressure);
    }
};

struct PlasticNet {  // parameters: strain that the limits are measured in, strain for stress (K/(2 mu))
    static constexpr bool RETURN_MAP = true;
    static constexpr int PARAMETERS = 2, FEATURES = 2, OUTPUTS = 3;
    template <class S> static void features(const S h[3], S x[3]) {
        S dev[3];
        deviator(h, dev);
        const S volumetric = trace(h), shear = safe_root(sum_of_squares(dev));
        const S size = square_root(square(shear) + square(volumetric) + 1e-8), softened = shear + 1e-4;
        x[0] = volumetric / size;
        x[1] = 7.348469228349534 * dev[0] * dev[1] * dev[2] / (softened * softened * softened);
    }
    // (1 + 4 f)^2
    template <class S> static S limit(const S& f) {
        const V root = 1.0 + 4.0 * value_of(f);
        return chain(f, root * root, 8.0 * root);
    }
    // Strains after the return: flow(dev, shear, largest, change) says what a particle that yields adds to dev h.
    template <class S, class Flow> static void to_surface(const S h[3], const S* p, const S* f, S y[3], Flow flow) {
        S dev[3], change[3];
        deviator(h, dev);
        const S volumetric = trace(h), shear = safe_root(sum_of_squares(dev)), zero = constant(V{}, shear);
        const S tension = p[0] * limit(f[0]), cohesion = p[0] * limit(f[1]),
                friction = p[1] * softplus(4.0 * f[2] + SOFTPLUS_ONE);
        const S after = select(value_of(volumetric) > value_of(tension), tension, volumetric);
        const S largest = cohesion + friction * select(value_of(after) < 0.0, -after, zero);
        const Mask yields = value_of(shear) > value_of(largest);
        const S mean = (after - volumetric) / 3.0;
        flow(dev, select(yields, shear, zero + 1.0), largest, change);
        for (int i = 0; i < 3; i++) y[i] = select(yields, change[i], zero) + mean;
    }
    template <class S> static void respond(const S h[3], const S*, const S* p, const S* f, S y[3]) {
        to_surface(h, p, f, y, [](const S dev[3], const S& shear, const S& largest, S change[3]) {
            const S share = largest / shear - 1.0;
            for (int i = 0; i < 3; i++) change[i] = share * dev[i];
        });
    }
};

struct FreeFlowPlasticNet : PlasticNet {
    static constexpr int OUTPUTS = 4;
    static constexpr double TURN = 9.797958971132712;  // 4 sqrt(6)
    template <class S> static void respond(const S h[3], const S*, const S* p, const S* f, S y[3]) {
        to_surface(h, p, f, y, [&](const S dev[3], const S& shear, const S& largest, S change[3]) {
            S n[3], w[3];
            for (int i = 0; i < 3; i++) n[i] = dev[i] / shear;
            const S third = sum_of_squares(n) / 3.0, lode = 3.0 * (n[0] * n[1] * n[2]);
            const S turn = (shear - largest) * TURN * f[3], one = constant(V{}, third) + 1.0;
            for (int i = 0; i < 3; i++) w[i] = largest * n[i] - turn * (square(n[i]) - third - lode * n[i]);
            const S length = safe_root(sum_of_squares(w));
            const S share = largest / select(value_of(length) > 0.0, length, one);
            for (int i = 0; i < 3; i++) change[i] = share * w[i] - dev[i];
        });
    }
};

}  // namespace pcnclaws
