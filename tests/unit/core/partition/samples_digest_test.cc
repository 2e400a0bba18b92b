#include "core/partition/samples_digest.h"

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::partition {
namespace {

volume::GridGeometry Geometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {3, 2, 2};
  return geometry;
}

// Rows (y, z) of Geometry().
struct Row {
  std::int64_t y = 0;
  std::int64_t z = 0;
  std::string samples;
};
const std::vector<Row>& Rows() {
  static const std::vector<Row>* const rows =
      new std::vector<Row>{{0, 0, "abc"}, {1, 0, "def"}, {0, 1, "ghi"}, {1, 1, "jkl"}};
  return *rows;
}

std::string DigestOf(const std::vector<Row>& rows,
                     const volume::GridGeometry& geometry = Geometry(),
                     volume::ScalarType type = volume::ScalarType::kUint8) {
  SamplesDigest digest;
  for (const Row& row : rows) {
    digest.AddRow(row.y, row.z, row.samples);
  }
  return digest.Finish(geometry, type);
}

TEST(SamplesDigestTest, ValueStaysAsDocumented) {
  // Written out: pictures on disk carry it. From docs/format/dataset.md in Python:
  //   s = sum(int.from_bytes(sha256(pack("<qq", y, z) + row).digest(), "little") ...) % 2**256
  EXPECT_EQ(DigestOf(Rows()), "4ea804350f90f792ebde25222dd30232");
}

// Digests of rows hardly ever have a word of ones, whose carry comes from the word before.
TEST(SamplesDigestTest, CarriesGoThroughWordsOfOnes) {
  constexpr std::uint64_t kOnes = ~std::uint64_t{0};
  const DigestSum one{1, 0, 0, 0};
  EXPECT_EQ(SumOf({kOnes, 5, 6, 7}, one), (DigestSum{0, 6, 6, 7}));
  EXPECT_EQ(SumOf({kOnes, kOnes, 6, 7}, one), (DigestSum{0, 0, 7, 7}));
  EXPECT_EQ(SumOf(one, {kOnes, kOnes, kOnes, 7}), (DigestSum{0, 0, 0, 8}));
  EXPECT_EQ(SumOf({kOnes, kOnes, kOnes, kOnes}, one), DigestSum()) << "modulo 2^256";
  EXPECT_EQ(SumOf({kOnes, kOnes, kOnes, kOnes}, {kOnes, kOnes, kOnes, kOnes}),
            (DigestSum{kOnes - 1, kOnes, kOnes, kOnes}));
  EXPECT_EQ(SumOf({3, kOnes, 0, 0}, {4, 1, 0, 0}), (DigestSum{7, 0, 1, 0}));
}

TEST(SamplesDigestTest, OrderOfRowsAndPartialSumsDoNotShow) {
  std::vector<Row> backwards(Rows().rbegin(), Rows().rend());
  EXPECT_EQ(DigestOf(backwards), DigestOf(Rows()));
  SamplesDigest first;
  SamplesDigest second;
  for (std::size_t i = 0; i < Rows().size(); ++i) {
    (i % 2 == 0 ? first : second).AddRow(Rows()[i].y, Rows()[i].z, Rows()[i].samples);
  }
  first.Add(second);
  EXPECT_EQ(first.Finish(Geometry(), volume::ScalarType::kUint8), DigestOf(Rows()));
}

TEST(SamplesDigestTest, EverySampleItsPlaceTheGridAndTheTypeShow) {
  std::set<std::string> digests{DigestOf(Rows())};
  std::size_t expected = 1;
  const auto add = [&](const std::string& digest) {
    digests.insert(digest);
    EXPECT_EQ(digests.size(), ++expected) << "change " << expected - 1 << " does not show";
  };
  for (std::size_t row = 0; row < 4; ++row) {
    for (std::size_t x = 0; x < 3; ++x) {
      std::vector<Row> changed = Rows();
      changed[row].samples[x] = '!';
      add(DigestOf(changed));
    }
  }
  std::vector<Row> swapped = Rows();
  swapped[0].samples.swap(swapped[3].samples);
  add(DigestOf(swapped));
  add(DigestOf(Rows(), Geometry(), volume::ScalarType::kInt8));
  for (void (*change)(volume::GridGeometry*) : std::vector<void (*)(volume::GridGeometry*)>{
           [](volume::GridGeometry* g) {
             g->sample_dims = {2, 3, 2};
           },
           [](volume::GridGeometry* g) { g->spacing.z = 2; },
           [](volume::GridGeometry* g) { g->origin.x = 1; },
           [](volume::GridGeometry* g) { g->direction.columns[1].y = -1; }}) {
    volume::GridGeometry geometry = Geometry();
    change(&geometry);
    add(DigestOf(Rows(), geometry));
  }
}

}  // namespace
}  // namespace isoscope::partition
