// A law at one particle: its answer, and how that changes along directions of F and of the internal variables.
#pragma once

namespace pcnclaws {

class LawPoint {
  public:
    // F row by row; all internal variables, of which the law reads its own
    LawPoint(const Parameters& p, const double f[9], const double* variables, double time_step)
        : input{1, f, rows, PARAMETER_ROWS, nullptr, internal}, block(input, &network) {
        coefficients(p, time_step, rows);
        for (int k = 0; k < INTERNAL; k++) internal[k] = variables[VARIABLES[k]];
    }
    LawPoint(const LawPoint&) = delete;  // parts point to each other
    LawPoint& operator=(const LawPoint&) = delete;

    // the result row by row, and the law's internal variables after plastic flow
    void answer(double result[9], double* after) {
        block.template enter<false>(0, 1);
        V y[Block::VALUES];
        block.respond(0, y);
        block.leave(0, y, LawFields<double>{result, after});
    }
    // what along() needs
    void linearise() { block.template enter<true>(0, 1); }
    void along(const double f_rate[9], const double* internal_rate, double result[9], double* after,
               double result_rate[9], double* after_rate) {
        const double constant[PARAMETER_ROWS + 1] = {};
        typename Block::Rates rates;
        block.rates_first(0, f_rate, constant, rates);
        if constexpr (Block::NETWORK) network.rates();
        block.rates_second(0, constant, internal_rate, rates, LawFields<double>{result, after},
                           LawFields<double>{result_rate, after_rate});
    }

  private:
    typedef LawBlock<double, Law, PlainNetwork> Block;
    double rows[PARAMETER_ROWS + 1] = {}, internal[INTERNAL + 1] = {};
    PlainNetwork network{};
    LawInput<double> input;
    Block block;
};

}  // namespace pcnclaws
