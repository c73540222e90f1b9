// What a law is computed from.
#pragma once
#include "lanes.hpp"

namespace pcnclaws {

constexpr int LAYERS = LAW_LAYERS;
constexpr int PARAMETER_ROWS = LAW_ROWS;  // of per-particle parameters

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
};

}  // namespace pcnclaws
