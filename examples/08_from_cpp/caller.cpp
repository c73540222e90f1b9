// Calls a law from C++: states on the standard input, a line each; answers on the standard output, a line each.
//
//   python -m pcnclaws.export law=sand output=sand.hpp
//   g++ -std=c++17 -O2 -DLAW_HEADER='"sand.hpp"' -DLAW=pcnclaws_sand caller.cpp -o caller
//   echo "4e5 0.25 30  0  1 0.05 0  0 0.97 0  0 0 1" | ./caller
//
// A state: the physical parameters, the internal variables if there are any, the time step [s], and the trial deformation
// gradient row by row. An answer: F and the internal variables after plastic flow, the Kirchhoff stress of this F [Pa], and
// the derivatives d F / d trial, d tau / d trial (the consistent tangent), d tau / d F.
#include <cstdio>
#include <vector>

#include LAW_HEADER

static bool read(double* numbers, int count) {
    for (int k = 0; k < count; k++)
        if (std::scanf("%lf", numbers + k) != 1) return false;
    return true;
}

static void print(const double* numbers, int count) {
    for (int k = 0; k < count; k++) std::printf("%.17g ", numbers[k]);
}

int main() {
    double given[LAW::PARAMETER_COUNT], time_step, trial[9], f[9], tau[9], flow[81], consistent[81], elastic[81];
    std::vector<double> before(LAW::INTERNAL_VARIABLES), after(LAW::INTERNAL_VARIABLES);
    while (read(given, LAW::PARAMETER_COUNT) && read(before.data(), LAW::INTERNAL_VARIABLES) && read(&time_step, 1) &&
           read(trial, 9)) {
        const LAW::Parameters parameters = LAW::parameters_of(given);
        LAW::return_map(parameters, trial, before.data(), time_step, f, after.data(), flow);
        LAW::stress(parameters, f, after.data(), tau, elastic);
        LAW::update(parameters, trial, before.data(), time_step, f, after.data(), tau, consistent);
        print(f, 9);
        print(after.data(), LAW::INTERNAL_VARIABLES);
        print(tau, 9);
        print(flow, 81);
        print(consistent, 81);
        print(elastic, 81);
        std::puts("");
    }
}
