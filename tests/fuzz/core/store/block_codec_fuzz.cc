// The stored bytes of a block: decoding stays within its buffers, and undoes encoding.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/store/block_codec.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

using store::BlockEncoding;
using volume::ScalarType;

constexpr int kEncodingCount = static_cast<int>(BlockEncoding::kPacked) + 1;  // no overhangs
static_assert(128 % kEncodingCount == 0, "seeds count on it");
constexpr int kMaxSide = 24;

void Decode(BlockEncoding encoding, ScalarType type, const math::Index3& dims,
            absl::string_view stored) {
  const std::size_t raw_size = static_cast<std::size_t>(math::Volume(dims)) * SizeOf(type);
  // Exactly as large, so that a sanitizer sees what is written beyond it.
  const auto out = std::make_unique<char[]>(raw_size);
  std::string scratch;
  const absl::Status status = store::DecodeBlock(encoding, type, dims, stored, &scratch, out.get());
  if (!status.ok()) {
    RequireError(status, {absl::StatusCode::kDataLoss});
    return;
  }
  Require(encoding != BlockEncoding::kRaw || stored == absl::string_view(out.get(), raw_size),
          "raw samples are taken as they are");
}

// Takes rows and planes of the given size, as many planes as there are bytes for.
void RoundTrip(BlockEncoding wanted, ScalarType type, math::Index3 dims, absl::string_view bytes) {
  const std::size_t plane_bytes = static_cast<std::size_t>(dims.x * dims.y) * SizeOf(type);
  dims.z = static_cast<std::int64_t>(bytes.size() / plane_bytes);
  if (dims.z == 0) {
    return;
  }
  const absl::string_view samples = bytes.substr(0, static_cast<std::size_t>(dims.z) * plane_bytes);
  std::string stored;
  const BlockEncoding encoding = store::EncodeBlock(wanted, type, dims, samples, &stored);
  Require(encoding == BlockEncoding::kRaw || stored.size() < samples.size(),
          "what is compressed is smaller");
  const auto out = std::make_unique<char[]>(samples.size());
  std::string scratch;
  Require(store::DecodeBlock(encoding, type, dims, stored, &scratch, out.get()).ok() &&
              samples == absl::string_view(out.get(), samples.size()),
          "decoding undoes encoding");
}

void Run(Input input) {
  const std::uint8_t mode = input.Byte();
  const auto encoding = static_cast<BlockEncoding>(mode % kEncodingCount);
  const auto type = static_cast<ScalarType>(1 + input.Byte() % 8);
  math::Index3 dims;
  for (int axis = 0; axis < 3; ++axis) {
    dims[axis] = 1 + input.Byte() % kMaxSide;
  }
  const absl::string_view rest = input.Rest();
  if (mode < 128) {
    Decode(encoding, type, dims, rest);
  } else {
    RoundTrip(encoding, type, dims, rest);
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  std::string samples;
  for (int i = 0; i < 720; ++i) {
    samples.append({static_cast<char>(i / 9), static_cast<char>(i % 9 / 4)});
  }
  for (int encoding = 0; encoding < kEncodingCount; ++encoding) {
    for (const char type : {'\0', '\3', '\6'}) {  // uint8, int16, float32
      // 8 x 9 x 20 bytes: all of the samples.
      const int width = static_cast<int>(SizeOf(static_cast<ScalarType>(1 + type)));
      const math::Index3 dims{8 / width, 9, 20};
      std::string stored;
      const auto used =
          store::EncodeBlock(static_cast<BlockEncoding>(encoding),
                             static_cast<ScalarType>(1 + type), dims, samples, &stored);
      const std::string head{type, static_cast<char>(dims.x - 1), static_cast<char>(dims.y - 1),
                             static_cast<char>(dims.z - 1)};
      seeds.push_back(std::string(1, static_cast<char>(used)) + head + stored);
      // 128, 129, ...: encodings 0, 1, ... there and back.
      seeds.push_back(std::string(1, static_cast<char>(128 + encoding)) + head + samples);
    }
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
