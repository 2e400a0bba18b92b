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

constexpr std::size_t kMaxRawBytes = std::size_t{1} << 16;

void Decode(BlockEncoding encoding, ScalarType type, std::size_t raw_size,
            absl::string_view stored) {
  // Exactly as large, so that a sanitizer sees what is written beyond it.
  const auto out = std::make_unique<char[]>(raw_size);
  std::string scratch;
  const absl::Status status =
      store::DecodeBlock(encoding, type, stored, raw_size, &scratch, out.get());
  if (!status.ok()) {
    RequireError(status, {absl::StatusCode::kDataLoss});
    return;
  }
  Require(encoding != BlockEncoding::kRaw || stored == absl::string_view(out.get(), raw_size),
          "raw samples are taken as they are");
}

void RoundTrip(BlockEncoding wanted, ScalarType type, absl::string_view bytes) {
  const absl::string_view samples = bytes.substr(0, bytes.size() - bytes.size() % SizeOf(type));
  if (samples.empty()) {
    return;
  }
  std::string stored;
  const BlockEncoding encoding = store::EncodeBlock(wanted, type, samples, &stored);
  Require(encoding == BlockEncoding::kRaw || stored.size() < samples.size(),
          "what is compressed is smaller");
  const auto out = std::make_unique<char[]>(samples.size());
  std::string scratch;
  Require(store::DecodeBlock(encoding, type, stored, samples.size(), &scratch, out.get()).ok() &&
              samples == absl::string_view(out.get(), samples.size()),
          "decoding undoes encoding");
}

void Run(Input input) {
  const std::uint8_t mode = input.Byte();
  const auto encoding = static_cast<BlockEncoding>(mode % 3);
  const auto type = static_cast<ScalarType>(1 + input.Byte() % 8);
  const std::size_t raw_size = input.Short() % kMaxRawBytes;
  const absl::string_view rest = input.Rest();
  if (mode < 128) {
    Decode(encoding, type, raw_size - raw_size % SizeOf(type), rest);
  } else {
    RoundTrip(encoding, type, rest);
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  std::string samples;
  for (int i = 0; i < 729; ++i) {
    samples.append({static_cast<char>(i / 9), static_cast<char>(i % 9 / 4)});
  }
  for (int encoding = 0; encoding < 3; ++encoding) {
    for (const char type : {'\0', '\3', '\6'}) {  // uint8, int16, float32
      std::string stored;
      const absl::string_view block_samples = absl::string_view(samples).substr(0, 1456);
      const auto used =
          store::EncodeBlock(static_cast<BlockEncoding>(encoding),
                             static_cast<ScalarType>(1 + type), block_samples, &stored);
      const std::string head{type, static_cast<char>(1456 % 256), static_cast<char>(1456 / 256)};
      seeds.push_back(std::string(1, static_cast<char>(used)) + head + stored);
      // 129, 130, 131: encodings 0, 1, 2 there and back.
      seeds.push_back(std::string(1, static_cast<char>(129 + encoding)) + head +
                      std::string(block_samples));
    }
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
