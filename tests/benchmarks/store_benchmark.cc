// Encoding and decoding a block of 19^3 samples, by encoding and type: of a smooth field, and of the
// same with noise as of a scanner. Bytes a second are those of the samples; `size` is the share of
// them that is stored.

#include <cmath>
#include <cstdint>
#include <string>

#include "absl/strings/str_cat.h"
#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/math/vec.h"
#include "core/store/block_codec.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {
namespace {

constexpr math::Index3 kDims{19, 19, 19};
constexpr int kSamples = 19 * 19 * 19;

// About normal: the sum of four uniform numbers. Its standard deviation is `sigma`.
double Noise(int i, double sigma) {
  double sum = 0;
  for (std::uint64_t k = 0; k < 4; ++k) {
    sum += static_cast<double>(base::RandomBits(k, static_cast<std::uint64_t>(i)) >> 11) * 0x1p-53;
  }
  return (sum - 2) * sigma * std::sqrt(3.0);
}

template <typename T>
void AppendSamples(double scale, double sigma, std::string* bytes) {
  for (int i = 0; i < kSamples; ++i) {
    const int row = i / 19;
    const int plane = row / 19;
    const double x = i % 19;
    const double y = row % 19;
    const double z = plane;
    const double smooth = 2 + std::sin(0.11 * x + 0.07 * y) + std::cos(0.09 * z - 0.05 * x);
    base::AppendLittleEndian(static_cast<T>((smooth + Noise(i, sigma)) * scale), bytes);
  }
}

std::string SamplesOf(volume::ScalarType type, double sigma) {
  std::string bytes;
  switch (type) {
    case volume::ScalarType::kUint8:
      AppendSamples<std::uint8_t>(50, sigma, &bytes);
      break;
    case volume::ScalarType::kUint16:
      AppendSamples<std::uint16_t>(1000, sigma, &bytes);  // 12 bits
      break;
    default:
      AppendSamples<float>(1, sigma, &bytes);
  }
  return bytes;
}

struct Block {
  explicit Block(const benchmark::State& state)
      : wanted(static_cast<BlockEncoding>(state.range(0))),
        type(static_cast<volume::ScalarType>(state.range(1))),
        samples(SamplesOf(type, 0.001 * static_cast<double>(state.range(2)))),
        encoding(EncodeBlock(wanted, type, kDims, samples, &stored)) {}

  BlockEncoding wanted;
  volume::ScalarType type;
  std::string samples;
  std::string stored;
  BlockEncoding encoding;
};

void Report(const Block& block, benchmark::State* state) {
  state->SetBytesProcessed(static_cast<std::int64_t>(state->iterations()) *
                           static_cast<std::int64_t>(block.samples.size()));
  state->SetLabel(absl::StrCat(volume::NameOf(block.type), " ", NameOf(block.encoding)));
  state->counters["size"] =
      static_cast<double>(block.stored.size()) / static_cast<double>(block.samples.size());
}

void BM_Encode(benchmark::State& state) {
  Block block(state);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        EncodeBlock(block.wanted, block.type, kDims, block.samples, &block.stored));
  }
  Report(block, &state);
}

void BM_Decode(benchmark::State& state) {
  const Block block(state);
  std::string scratch;
  std::string out(block.samples.size(), '\0');
  for (auto _ : state) {
    ISOSCOPE_CHECK(
        DecodeBlock(block.encoding, block.type, kDims, block.stored, &scratch, out.data()).ok());
    benchmark::ClobberMemory();
  }
  ISOSCOPE_CHECK(out == block.samples);
  Report(block, &state);
}

void Cases(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"encoding", "type", "noise"});
  for (const volume::ScalarType type :
       {volume::ScalarType::kUint8, volume::ScalarType::kUint16, volume::ScalarType::kFloat32}) {
    for (const int noise : {0, 20}) {
      for (const BlockEncoding encoding : {BlockEncoding::kRaw, BlockEncoding::kPacked,
                                           BlockEncoding::kLz4, BlockEncoding::kZstd}) {
        benchmark->Args({static_cast<int>(encoding), static_cast<int>(type), noise});
      }
    }
  }
}
BENCHMARK(BM_Encode)->Apply(Cases);
BENCHMARK(BM_Decode)->Apply(Cases);

}  // namespace
}  // namespace isoscope::store
