// Linked to the drivers of libFuzzer: with ISOSCOPE_FUZZ_SEEDS=FOLDER in the environment, the
// program writes its seeds there, one a file, and ends. scripts/fuzz.sh begins so.

#include <cstddef>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include "core/base/log.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  isoscope::base::SetLogLevel(isoscope::base::LogLevel::kOff);
  const char* const folder = std::getenv("ISOSCOPE_FUZZ_SEEDS");
  if (folder == nullptr) {
    return 0;
  }
  const std::vector<std::string> seeds = isoscope::fuzz::Seeds();
  for (std::size_t i = 0; i < seeds.size(); ++i) {
    const std::string path = std::string(folder) + "/seed-" + std::to_string(i);
    std::ofstream file(path, std::ios::binary | std::ios::trunc);
    file.write(seeds[i].data(), static_cast<std::streamsize>(seeds[i].size()));
    if (!file.flush().good()) {
      std::cerr << path << ": can't be written\n";
      std::exit(1);
    }
  }
  std::exit(0);
}
