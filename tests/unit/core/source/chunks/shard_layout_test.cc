#include "core/source/chunks/shard_layout.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/chunk_writer.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ShardFile;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kDataLoss = absl::StatusCode::kDataLoss;

ChunkJson Configuration(const std::string& more = "") {
  return ChunkJson::parse(absl::StrCat(
      R"({"chunk_shape": [2, 2], "codecs": [{"name": "bytes"}],
          "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, "crc32c"])",
      more, "}"));
}
const ChunkData kShard = ArrayData({4, 4}, NumberType::kUint8, "z");

ShardFile File() {
  ShardFile file;
  file.chunks = {"abcd", std::nullopt, "efgh", "ijkl"};
  return file;
}

absl::StatusOr<std::string> DecodeWhole(const ChunkJson& configuration, const std::string& bytes) {
  const std::vector<CodecSpec> codecs = {
      {.name = "sharding_indexed", .configuration = configuration}};
  auto chain = CodecChain::Make(codecs, kShard);
  return chain.ok() ? chain->Decode(bytes) : chain.status();
}

TEST(ShardLayoutTest, ReadsTheIndex) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto layout, ShardLayout::Make(Configuration(), kShard));
  EXPECT_EQ(layout->index_bytes(), 4 * 16 + 4);
  EXPECT_TRUE(layout->is_index_at_end());
  EXPECT_EQ(layout->max_bytes(), 4 * 4 + 68);
  const std::string bytes = File().Bytes();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto entries, layout->DecodeIndex(bytes.substr(12)));
  ASSERT_EQ(entries.size(), 4U);
  EXPECT_EQ(entries[0].offset, 0);
  EXPECT_FALSE(entries[1].is_there());
  EXPECT_EQ(entries[3].offset, 8);
  EXPECT_EQ(entries[3].size, 4);
}

TEST(ShardLayoutTest, DecodesWholeShardsWithTheIndexAtEitherEnd) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string end,
                                DecodeWhole(Configuration(), File().Bytes()));
  EXPECT_EQ(end, "abzzcdzzefijghkl");
  ShardFile file = File();
  file.is_index_at_end = false;
  file.order = {3, 0, 2};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string start,
      DecodeWhole(Configuration(R"(, "index_location": "start")"), file.Bytes()));
  EXPECT_EQ(start, end);
}

// "Unused space between them is allowed", says the specification: whoever appends chunks leaves some.
// The room for it is there no more if a shard counts the bytes of its chunks and its index alone.
TEST(ShardLayoutTest, DecodesWholeShardsWithUnusedBytes) {
  for (const bool is_index_at_end : {true, false}) {
    ShardFile file = File();
    file.gap = 1000;
    file.is_index_at_end = is_index_at_end;
    const ChunkJson configuration =
        Configuration(is_index_at_end ? "" : R"(, "index_location": "start")");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string decoded,
                                  DecodeWhole(configuration, file.Bytes()));
    EXPECT_EQ(decoded, "abzzcdzzefijghkl");
    // A shard in a shard, of which it is the only chunk.
    ShardFile outer;
    outer.chunks = {file.Bytes()};
    const ChunkJson nested = {
        {"chunk_shape", {4, 4}},
        {"codecs", {{{"name", "sharding_indexed"}, {"configuration", configuration}}}},
        {"index_codecs", {"bytes", "crc32c"}}};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string from_nested,
                                  DecodeWhole(nested, outer.Bytes()));
    EXPECT_EQ(from_nested, decoded);
  }
}

TEST(ShardLayoutTest, RefusesDamage) {
  const std::string good = File().Bytes();
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_THAT(DecodeWhole(Configuration(), good.substr(0, size)), StatusIs(kDataLoss));
  }
  for (std::size_t i = 12; i < good.size(); ++i) {
    std::string bad = good;
    bad[i] ^= 4;
    EXPECT_THAT(DecodeWhole(Configuration(), bad), StatusIs(kDataLoss, HasSubstr("checksum")));
  }
  // Without a checksum, entries must still make sense.
  const auto plain = ChunkJson::parse(
      R"({"chunk_shape": [2, 2], "codecs": ["bytes"], "index_codecs": ["bytes"]})");
  ShardFile file = File();
  file.has_checksum = false;
  const std::string unchecked = file.Bytes();
  for (const std::size_t byte : {12U, 19U, 20U, 27U, 12U + 16U, 12U + 24U}) {
    std::string bad = unchecked;
    bad[byte] = 77;
    EXPECT_THAT(DecodeWhole(plain, bad), StatusIs(kDataLoss)) << byte;
  }
}

TEST(ShardLayoutTest, RefusesConfigurationsThatMakeNoSense) {
  const auto make = [](const std::string& text) {
    return ShardLayout::Make(ChunkJson::parse(text), kShard);
  };
  const std::string index = R"("index_codecs": ["bytes"])";
  const std::string codecs = R"("codecs": ["bytes"])";
  for (const char* shape : {"[2]", "[2, 3]", "[0, 2]", "[8, 4]", "[-2, 2]", "\"a\"", "[2, 2.0]",
                            "[2, 9223372036854775807]"}) {
    EXPECT_THAT(make(absl::StrCat("{\"chunk_shape\": ", shape, ", ", codecs, ", ", index, "}")),
                StatusIs(kInvalid))
        << shape;
  }
  const std::string shape = R"({"chunk_shape": [2, 2], )";
  EXPECT_THAT(make(shape + codecs + "}"), StatusIs(kInvalid, HasSubstr("index_codecs")));
  EXPECT_THAT(make(shape + index + "}"), StatusIs(kInvalid, HasSubstr("codecs")));
  EXPECT_THAT(make(shape + codecs + R"(, "index_codecs": ["bytes", "gzip"]})"),
              StatusIs(kInvalid, HasSubstr("compress")));
  EXPECT_THAT(make(shape + codecs + ", " + index + R"(, "index_location": "middle"})"),
              StatusIs(kInvalid, HasSubstr("index_location")));
  EXPECT_THAT(make(shape + R"("codecs": ["bytes", "blosc2"], )" + index + "}"),
              StatusIs(kInvalid, HasSubstr("blosc2")));
  EXPECT_THAT(ShardLayout::Make(ChunkJson::parse(R"({"chunk_shape": [1, 1], "codecs": ["bytes"],
                                                     "index_codecs": ["bytes"]})"),
                                ArrayData({4096, 4096}, NumberType::kUint8, "z")),
              StatusIs(kInvalid, HasSubstr("more than 4194304 chunks")));
}

}  // namespace
}  // namespace isoscope::source
