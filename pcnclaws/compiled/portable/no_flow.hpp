// What stands in law_point.hpp for the plastic law of a purely elastic material.
#pragma once

namespace pcnclaws {

constexpr int INTERNAL = 0;
constexpr int VARIABLES[] = {0};

class LawPoint {
  public:
    LawPoint(const Parameters&, const double f[9], const double*, double) { std::copy(f, f + 9, trial); }
    void answer(double result[9], double*) { std::copy(trial, trial + 9, result); }
    void linearise() {}
    void along(const double f_rate[9], const double*, double result[9], double*, double result_rate[9], double*) {
        std::copy(trial, trial + 9, result);
        std::copy(f_rate, f_rate + 9, result_rate);
    }

  private:
    double trial[9];
};

}  // namespace pcnclaws
