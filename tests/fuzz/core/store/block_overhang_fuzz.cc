// Overhangs of blocks: decoding stays within its buffers, and undoes encoding.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/base/crc32c.h"
#include "core/store/block_overhang.h"
#include "core/store/sample_reader.h"
#include "core/volume/block_samples.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

using volume::ScalarType;

constexpr int kMaxSide = 24;
constexpr std::size_t kHeadBytes = 15;

struct Case {
  volume::BlockLayout layout;
  store::SourceSamples source;
  ScalarType type = ScalarType::kUint8;
  volume::BlockId id = 0;
};

Case TakeCase(Input* input) {
  Case drawn;
  drawn.type = static_cast<ScalarType>(1 + input->Byte() % 8);
  math::Index3 dims;
  math::Index3 cells;
  for (int axis = 0; axis < 3; ++axis) {
    dims[axis] = 2 + input->Byte() % kMaxSide;
    cells[axis] = 1 + input->Byte() % kMaxSide;
    drawn.source.unit_dims[axis] = 1 + input->Byte() % kMaxSide;
    drawn.source.unit_origin[axis] = -(input->Byte() % drawn.source.unit_dims[axis]);
  }
  drawn.layout = *volume::BlockLayout::Make(dims, cells);
  drawn.id = static_cast<volume::BlockId>(input->Byte() % drawn.layout.block_count());
  return drawn;
}

void Decode(const Case& of, absl::string_view stored) {
  const std::size_t size = volume::StoredSizeBytes(of.layout, of.id, of.type);
  // Exactly as large, so that a sanitizer sees what is written beyond it.
  const auto samples = std::make_unique<char[]>(size);
  const auto crc32c =
      store::DecodeOverhang(of.layout, of.source, of.type, of.id, stored, samples.get());
  if (!crc32c.ok()) {
    RequireError(crc32c.status(), {absl::StatusCode::kDataLoss});
  }
}

// Repeats the bytes as often as the block needs them.
void RoundTrip(const Case& of, absl::string_view bytes) {
  std::string samples(volume::StoredSizeBytes(of.layout, of.id, of.type), '\0');
  for (std::size_t i = 0; i < samples.size() && !bytes.empty(); ++i) {
    samples[i] = bytes[i % bytes.size()];
  }
  std::string stored;
  const store::BlockEncoding encoding =
      store::EncodeOverhang(of.layout, of.source, of.type, of.id, samples, &stored);
  if (encoding == store::BlockEncoding::kRaw) {
    Require(stored == samples, "a raw block has its samples");
    return;
  }
  Require(stored.size() < samples.size(), "an overhang is smaller");
  std::string found = samples;  // the unit's part is there before
  const auto crc32c =
      store::DecodeOverhang(of.layout, of.source, of.type, of.id, stored, found.data());
  Require(crc32c.ok() && *crc32c == base::Crc32c(samples) && found == samples,
          "decoding undoes encoding");
}

void Run(Input input) {
  const bool decodes = input.Byte() < 128;
  const Case of = TakeCase(&input);
  if (decodes) {
    Decode(of, input.Rest());
  } else {
    RoundTrip(of, input.Rest());
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  for (const int unit : {0, 7, 15, 23}) {
    std::string head(kHeadBytes, '\0');
    head[1] = 2;  // uint16
    for (std::size_t axis = 0; axis < 3; ++axis) {
      head[2 + 4 * axis] = 20;
      head[3 + 4 * axis] = 9;
      head[4 + 4 * axis] = static_cast<char>(unit);
    }
    std::string samples = "several samples of some block";
    seeds.push_back('\x80' + head.substr(1) + samples);
    Input input(reinterpret_cast<const std::uint8_t*>(head.data()), head.size());
    input.Byte();
    const Case of = TakeCase(&input);
    samples.resize(volume::StoredSizeBytes(of.layout, of.id, of.type), 's');
    std::string stored;
    store::EncodeOverhang(of.layout, of.source, of.type, of.id, samples, &stored);
    seeds.push_back(head + stored);
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
