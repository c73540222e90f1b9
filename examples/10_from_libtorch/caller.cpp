// Calls an AOTInductor package of a law with libtorch alone: states on the standard input, a line each, all at once as a
// batch; answers on the standard output, a line each.
//
//   python -m pcnclaws.export law=sand output=sand.pt2
//   cmake -B build -DCMAKE_PREFIX_PATH=$(python -c 'import torch; print(torch.utils.cmake_prefix_path)') . && cmake --build build
//   (echo "4e5 0.25 30  1 0.05 0  0 0.97 0  0 0 1"; echo "4e5 0.25 30  0.98 0 0  0 1 0  0 0 1") | build/caller sand.pt2
//
// A state: the physical parameters in the order of law.parameter_names, and the trial deformation gradient row by row. An
// answer: F after plastic flow, the Kirchhoff stress of this F [Pa], d F / d trial, and d tau / d trial.
#include <torch/csrc/inductor/aoti_package/model_package_loader.h>
#include <torch/torch.h>

#include <cstdio>
#include <exception>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

int main(int count, char** words) {
    if (count != 2) {
        std::cerr << "error: usage: caller PACKAGE < STATES\n";
        return 2;
    }
    std::vector<double> numbers;
    int64_t particles = 0;
    for (std::string line; std::getline(std::cin, line); particles++) {
        std::istringstream words_of_line(line);
        for (double number; words_of_line >> number;) numbers.push_back(number);
    }
    if (particles < 2 || numbers.size() % particles != 0 || numbers.size() / particles < 10) {
        std::cerr << "error: give at least two states: parameters and nine components of F, a line each\n";
        return 2;
    }
    const int64_t width = static_cast<int64_t>(numbers.size()) / particles;
    const torch::Tensor table = torch::from_blob(numbers.data(), {particles, width}, torch::kFloat64);
    const torch::Tensor parameters = table.narrow(1, 0, width - 9).contiguous();
    const torch::Tensor trial = table.narrow(1, width - 9, 9).contiguous().view({particles, 3, 3});
    try {
        torch::inductor::AOTIModelPackageLoader law(words[1]);
        std::vector<torch::Tensor> results;
        for (const torch::Tensor& one : law.run({trial, parameters})) results.push_back(one.reshape({particles, -1}));
        const torch::Tensor answers = torch::cat(results, 1).contiguous();
        const double* answer = answers.data_ptr<double>();
        for (int64_t i = 0; i < particles; i++, std::puts(""))
            for (int64_t j = 0; j < answers.size(1); j++) std::printf("%.17g ", *answer++);
    } catch (const std::exception& fault) {
        std::cerr << "error: " << std::string(fault.what()).substr(0, 400) << "\n";
        return 1;
    }
}
