// Runs a fuzz driver without libFuzzer and without its compiler: on its seeds and on seeded
// mutations of them, the same each time, or on the inputs in files.
//
//   DRIVER [--mutations N] [--seed S]    the seeds, then N mutations; this is what CTest runs
//   DRIVER FILE...                       each file once: to reproduce what libFuzzer found
//
// Whatever ends the program early leaves the input in DRIVER.crash, in the folder it was run in.

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "core/base/log.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
// Function of the sanitizers; null without them.
extern "C" void __sanitizer_set_death_callback(void (*callback)()) __attribute__((weak));

namespace isoscope::fuzz {
namespace {

constexpr std::size_t kMaxInputBytes = std::size_t{1} << 16;

// The input in work, for SaveInput.
const char* input_data = nullptr;
std::size_t input_size = 0;
std::string crash_path;

// Safe in a signal handler.
void SaveInput() {
  const int file = open(crash_path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  if (file >= 0 && input_data != nullptr) {
    if (write(file, input_data, input_size) == static_cast<ssize_t>(input_size)) {
      constexpr char kText[] = "the input is in ";
      constexpr char kEnd[] = "\n";
      // Without standard error there is no place for a message.
      ssize_t ignored = write(STDERR_FILENO, kText, sizeof(kText) - 1);
      ignored = write(STDERR_FILENO, crash_path.c_str(), crash_path.size());
      ignored = write(STDERR_FILENO, kEnd, sizeof(kEnd) - 1);
      static_cast<void>(ignored);
    }
    close(file);
  }
}

void OnSignal(int number) {
  SaveInput();
  std::signal(number, SIG_DFL);
  std::raise(number);
}

void SaveInputOfCrashes() {
  std::signal(SIGABRT, OnSignal);
  if (__sanitizer_set_death_callback != nullptr) {
    __sanitizer_set_death_callback(SaveInput);  // they have handlers for the signals below
    return;
  }
  for (const int number : {SIGSEGV, SIGBUS, SIGFPE, SIGILL}) {
    std::signal(number, OnSignal);
  }
}

void RunOne(const std::string& input) {
  // Exactly as large, so that a sanitizer sees a read past its end.
  const std::vector<std::uint8_t> bytes(input.begin(), input.end());
  input_data = input.data();
  input_size = input.size();
  LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  input_data = nullptr;
}

// Changes inputs at random; a seed gives the same changes on every machine.
class Mutator {
 public:
  Mutator(std::uint64_t seed, const std::vector<std::string>* seeds)
      : random_(seed), seeds_(seeds) {}

  std::string Next() {
    std::string input = (*seeds_)[Below(seeds_->size())];
    for (std::size_t count = 1 + Below(4); count > 0; --count) {
      Change(&input);
    }
    input.resize(std::min(input.size(), kMaxInputBytes));
    return input;
  }

 private:
  std::size_t Below(std::size_t end) { return static_cast<std::size_t>(random_() % end); }
  char RandomByte() { return static_cast<char>(Below(256)); }

  void Change(std::string* input) {
    if (input->empty()) {
      input->push_back(RandomByte());
      return;
    }
    const std::size_t at = Below(input->size());
    const std::size_t count = 1 + Below(std::min<std::size_t>(input->size() - at, 64));
    switch (Below(8)) {
      case 0:
        (*input)[at] = static_cast<char>((*input)[at] ^ (1 << Below(8)));
        break;
      case 1:
        (*input)[at] = RandomByte();
        break;
      case 2:
        WriteExtreme(at, input);
        break;
      case 3:
        input->erase(at, count);
        break;
      case 4:
        input->insert(at, input->substr(at, count));
        break;
      case 5:
        input->insert(at, std::string(count, RandomByte()));
        break;
      case 6:
        input->resize(at);
        break;
      default: {
        const std::string& other = (*seeds_)[Below(seeds_->size())];
        if (!other.empty()) {
          const std::size_t from = Below(other.size());
          input->replace(at, count, other.substr(from, 1 + Below(64)));
        }
      }
    }
  }

  // Numbers at which sizes and counts overflow, in binary or in digits.
  void WriteExtreme(std::size_t at, std::string* input) {
    constexpr std::array<std::int64_t, 12> kNumbers{0,
                                                    1,
                                                    -1,
                                                    127,
                                                    255,
                                                    32767,
                                                    65535,
                                                    2147483647,
                                                    4294967295,
                                                    2147483648,
                                                    INT64_C(9223372036854775807),
                                                    4611686018427387904};
    const std::int64_t number = kNumbers[Below(kNumbers.size())];
    if ((*input)[at] >= '0' && (*input)[at] <= '9') {
      input->replace(at, 1, std::to_string(number));
      return;
    }
    std::array<char, sizeof(number)> bytes{};
    std::memcpy(bytes.data(), &number, sizeof(number));
    const std::size_t width = std::min(std::size_t{1} << Below(4), input->size() - at);
    input->replace(at, width, bytes.data(), width);
  }

  std::mt19937_64 random_;
  const std::vector<std::string>* seeds_;
};

int RunFiles(const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    std::ifstream file(path, std::ios::binary);
    const std::string input{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    if (file.bad() || !file.is_open()) {
      std::cerr << path << ": can't be read\n";
      return 2;
    }
    RunOne(input);
    std::cout << path << ": passed\n";
  }
  return 0;
}

int RunSeeds(std::uint64_t mutations, std::uint64_t seed) {
  const std::vector<std::string> seeds = Seeds();
  Require(!seeds.empty(), "a driver has seeds");
  for (const std::string& input : seeds) {
    RunOne(input);
  }
  Mutator mutator(seed, &seeds);
  for (std::uint64_t i = 0; i < mutations; ++i) {
    RunOne(mutator.Next());
  }
  std::cout << seeds.size() << " seeds and " << mutations << " mutations with seed " << seed
            << ": passed\n";
  return 0;
}

int Main(const std::vector<std::string>& arguments, const std::string& program) {
  base::SetLogLevel(base::LogLevel::kOff);
  crash_path = program.substr(program.rfind('/') + 1) + ".crash";
  SaveInputOfCrashes();
  std::uint64_t mutations = 1000;
  std::uint64_t seed = 1;
  std::vector<std::string> paths;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const bool is_mutations = arguments[i] == "--mutations";
    if (!is_mutations && arguments[i] != "--seed") {
      paths.push_back(arguments[i]);
      continue;
    }
    char* end = nullptr;
    const std::string value = ++i < arguments.size() ? arguments[i] : "";
    (is_mutations ? mutations : seed) = std::strtoull(value.c_str(), &end, 10);
    if (value.empty() || *end != '\0') {
      std::cerr << arguments[i - 1] << " needs a whole number, not \"" << value << "\"\n";
      return 2;
    }
  }
  return paths.empty() ? RunSeeds(mutations, seed) : RunFiles(paths);
}

}  // namespace
}  // namespace isoscope::fuzz

int main(int argc, char** argv) { return isoscope::fuzz::Main({argv + 1, argv + argc}, argv[0]); }
