// The scheme as a program for `sepv verify --exec`: one line of JSON in, one line out (sepv's docs/protocol.md).
// It takes only the rigid body, and therefore reads only the few numbers of JSON that this problem needs.
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "scheme.hpp"

// The hex floats of the first array after "key" in the text from `from` on; *end becomes the place of its "]".
static std::vector<double> numbers(const std::string &text, const std::string &key, size_t from, size_t *end) {
    std::vector<double> found;
    size_t at = text.find("\"" + key + "\"", from);
    if (at == std::string::npos) return found;
    at = text.find('[', at);
    const size_t last = text.find(']', at);
    for (size_t quote = text.find('"', at); quote < last; quote = text.find('"', text.find('"', quote + 1) + 1))
        found.push_back(std::strtod(text.c_str() + quote + 1, nullptr));
    if (end) *end = last;
    return found;
}

static double number(const std::string &text, const std::string &key, size_t from) {
    const size_t at = text.find("\"" + key + "\"", from);
    return std::strtod(text.c_str() + text.find('"', text.find(':', at)) + 1, nullptr);
}

static std::string answer_steps(const std::string &line) {
    if (line.find("\"rigid-body\"") == std::string::npos) return "\"skip\":\"only the rigid body\"";
    const auto inertia = numbers(line, "inertia", 0, nullptr), c = numbers(line, "noise", 0, nullptr);
    size_t at = line.find("\"steps\"");
    std::string states;
    for (at = line.find("{", at); at != std::string::npos; at = line.find("{", at + 1)) {
        const auto y = numbers(line, "y", at, nullptr), dW = numbers(line, "dW", at, nullptr);
        if (y.size() != 3 || inertia.size() != 3 || dW.size() != c.size()) return "\"error\":\"not a rigid body\"";
        double delta = number(line, "h", at);
        for (size_t j = 0; j < c.size(); ++j) delta += c[j] * dW[j];
        const auto next = midpoint({y[0], y[1], y[2]}, {inertia[0], inertia[1], inertia[2]}, delta);
        if (!next) return "\"error\":\"no convergence\"";
        char text[128];
        std::snprintf(text, sizeof text, "[\"%a\",\"%a\",\"%a\"]", (*next)[0], (*next)[1], (*next)[2]);
        states += (states.empty() ? "" : ",") + std::string(text);
    }
    return "\"y_next\":[" + states + "]";
}

static const char *const HELLO =
    "\"protocol\":1,\"scheme\":\"rigid midpoint\",\"problems\":[\"rigid-body\"],\"max_steps\":256,"
    "\"claims\":[\"energy\",\"casimir\",\"symmetry\"],\"mean_square_order\":1";

int main() {
    std::string line;
    while (std::getline(std::cin, line)) {
        const long id = std::atol(line.c_str() + line.find(':', line.find("\"id\"")) + 1);
        std::string answer = "\"error\":\"unknown type of message\"";
        if (line.find("\"stop\"") != std::string::npos) break;
        if (line.find("\"hello\"") != std::string::npos) answer = HELLO;
        else if (line.find("\"step\"") != std::string::npos) answer = answer_steps(line);
        std::cout << "{\"id\":" << id << "," << answer << "}" << std::endl;  // endl flushes the answer
    }
    return 0;
}
