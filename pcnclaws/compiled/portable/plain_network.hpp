// The network of one particle, in plain loops: unit[l] holds the activations of layer l, and gradient[l] their rates.
#pragma once

namespace pcnclaws {

struct PlainNetwork {
    typedef double Layers[LAYERS + 1][WIDEST];
    Layers unit, slope, gradient;

    static double get(const Layers& array, int layer, int, int k) { return array[layer][k]; }
    static void put(Layers& array, int layer, int, int k, double value) { array[layer][k] = value; }

    // unit[0] to unit[LAYERS]; SLOPE keeps what rates() needs
    template <bool SLOPE> void forward() {
        for (int l = 0; l < LAYERS; l++)
            for (int o = 0; o < SIZES[l + 1]; o++) {
                const double x = BIASES[l][o] + row(l, o, unit[l]);
                if (l + 1 == LAYERS) {
                    unit[l + 1][o] = x;
                    continue;
                }
                // GELU, with the normal distribution
                const double below = 0.5 * std::erfc(-0.7071067811865476 * x);
                unit[l + 1][o] = x * below;
                if (SLOPE) slope[l + 1][o] = below + x * (0.3989422804014327 * std::exp(-0.5 * x * x));
            }
    }

    // gradient[0] to gradient[LAYERS] along the way forward
    void rates() {
        for (int l = 0; l < LAYERS; l++)
            for (int o = 0; o < SIZES[l + 1]; o++)
                gradient[l + 1][o] = row(l, o, gradient[l]) * (l + 1 == LAYERS ? 1.0 : slope[l + 1][o]);
    }

  private:
    static double row(int l, int o, const double* x) {
        double sum = 0.0;
        for (int i = 0; i < SIZES[l]; i++) sum += WEIGHTS[l][o * SIZES[l] + i] * x[i];
        return sum;
    }
};

}  // namespace pcnclaws
