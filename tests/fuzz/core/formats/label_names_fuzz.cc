// Files of names of labels: what is accepted is what a dataset can hold.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/formats/label_names.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {

std::vector<std::string> Seeds() {
  return {"# table\n17 Left-Hippocampus 220 216 20 0\n0 Unknown 0 0 0 0\n",
          "17 220 216 20 1 1 1 \"left hippocampus\"\n",
          "value,name,color\n17,\"left, \"\"x\"\"\",#dcd814\n-2.5,\n"};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace isoscope;
  const absl::string_view text(reinterpret_cast<const char*>(data), size);
  const auto labels = source::ParseLabelNames(text, "names.csv");
  if (!labels.ok()) {
    fuzz::RequireError(labels.status(), {absl::StatusCode::kInvalidArgument}, "names.csv");
    return 0;
  }
  fuzz::Require(volume::ValidateLabels(*labels).ok(), "accepted labels are valid");
  return 0;
}
