// What a law is computed from.
#pragma once
#include "lanes.hpp"

namespace pcnclaws {

constexpr int LAYERS = LAW_LAYERS;
constexpr int PARAMETER_ROWS = LAW_ROWS;  // of per-particle parameters
constexpr int INTERNAL = LAW_INTERNAL;    // internal variables

// The weights as PyTorch keeps them: w[l] is (sizes[l + 1], sizes[l]), row-major.
template <class T> struct Weights {
    const T *w[LAYERS], *b[LAYERS];
    int sizes[LAYERS + 1];
};

template <class T> struct LawInput {
    int64_t particles;
    const T* deformation;  // F, (9, particles)
    const T* parameters;   // (rows, particles)
    int rows;
    const Weights<T>* weights;  // null without a network
    const T* internal;          // (INTERNAL, particles)
};

// F or a stress, (9, particles), and internal variables, (INTERNAL, particles): results, their gradients or their rates.
template <class T> struct LawFields {
    T* matrix;
    T* internal;
};

}  // namespace pcnclaws
