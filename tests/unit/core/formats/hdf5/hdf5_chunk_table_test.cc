// Texts that make sense, and those that do not; the whole way is in hdf5_boxes_test.cc.

#include "core/formats/hdf5/hdf5_chunk_table.h"

#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

using Texts = std::vector<std::string>;

// A volume of 2 x 1 x 2 chunks at step 3.
const Texts& GoodTexts() {
  static const auto* const texts = new Texts{"layout=chunks",
                                             "file=/data/run.h5",
                                             "dims=5 8 4 6",
                                             "space=1 2 3",
                                             "start=3 0 0 0",
                                             "chunk=1 4 4 5",
                                             "type=>i2",
                                             "filter=2 2",
                                             "filter=1 4",
                                             "fill=0102",
                                             "chunks=1000 1a4 0,-,2000 5 1,fffffffffff 1 0"};
  return *texts;
}

// The texts with one of the same key in its place; "key" alone leaves it out.
Texts With(const std::string& text) {
  const std::string key = text.substr(0, text.find('='));
  Texts texts;
  for (const std::string& good : GoodTexts()) {
    if (!absl::StartsWith(good, absl::StrCat(key, "="))) {
      texts.push_back(good);
    } else if (text != key) {
      texts.push_back(text);
    }
  }
  return texts;
}

TEST(Hdf5ChunkTableTest, TextsBecomeATable) {
  Hdf5ChunkTable table;
  bool is_complete = false;
  ASSERT_TRUE(AddHdf5Chunks(GoodTexts(), &table, &is_complete));
  EXPECT_TRUE(is_complete);
  EXPECT_EQ(table.layout, Hdf5Storage::kChunks);
  EXPECT_EQ(table.file, "/data/run.h5");
  EXPECT_EQ(table.dims, (ChunkIndex{5, 8, 4, 6}));
  EXPECT_EQ(table.chunk_dims, (ChunkIndex{1, 4, 4, 5}));
  EXPECT_EQ(table.space, (std::array<std::size_t, 3>{1, 2, 3}));
  EXPECT_EQ(table.start, (ChunkIndex{3, 0, 0, 0}));
  EXPECT_EQ(table.type.type, NumberType::kInt16);
  EXPECT_TRUE(table.type.is_big_endian);
  EXPECT_EQ(table.fill, "\x01\x02");
  EXPECT_EQ(table.filters,
            (std::vector<Hdf5TableFilter>{{.id = 2, .values = {2}}, {.id = 1, .values = {4}}}));
  EXPECT_EQ(table.counts(), (std::array<std::int64_t, 3>{2, 1, 2}));
  EXPECT_EQ(table.chunks,
            (std::vector<Hdf5TableChunk>{{.offset = 0x1000, .size = 0x1a4, .skipped_filters = 0},
                                         {},
                                         {.offset = 0x2000, .size = 5, .skipped_filters = 1},
                                         {.offset = 0xfffffffffff, .size = 1}}));
}

TEST(Hdf5ChunkTableTest, AListGoesOnInTheNextAnswer) {
  Hdf5ChunkTable table;
  bool is_complete = true;
  ASSERT_TRUE(AddHdf5Chunks(With("chunks=1000 1a4 0"), &table, &is_complete));
  EXPECT_FALSE(is_complete);
  ASSERT_TRUE(AddHdf5Chunks({"chunks=2000 5 1,-"}, &table, &is_complete));
  EXPECT_FALSE(is_complete);
  EXPECT_FALSE(AddHdf5Chunks({"fill=0102"}, &table, &is_complete));  // there would be no end
  ASSERT_TRUE(AddHdf5Chunks({"chunks=3000 5 1"}, &table, &is_complete));
  EXPECT_TRUE(is_complete);
  EXPECT_EQ(table.chunks.size(), 4U);
  EXPECT_FALSE(AddHdf5Chunks({"chunks=3000 5 1"}, &table, &is_complete));  // one too many
}

TEST(Hdf5ChunkTableTest, OtherLayoutsHaveNoChunks) {
  Hdf5ChunkTable table;
  bool is_complete = false;
  ASSERT_TRUE(AddHdf5Chunks({"layout=plain", "file=f", "dims=3 4 5", "space=0 1 2", "start=0 0 0",
                             "type=<f4", "offset=2048"},
                            &table, &is_complete));
  EXPECT_TRUE(is_complete);
  EXPECT_EQ(table.plain_offset, 2048);
  Hdf5ChunkTable other;
  ASSERT_TRUE(AddHdf5Chunks({"layout=other", "file=f", "dims=3 4 5", "space=0 1 2", "start=0 0 0"},
                            &other, &is_complete));
  EXPECT_EQ(other.layout, Hdf5Storage::kOther);
}

TEST(Hdf5ChunkTableTest, TextsThatMakeNoSense) {
  for (const char* const text : {"layout=rings",
                                 "file=",
                                 "file",
                                 "dims=5 8 4",
                                 "dims=5 8 4 0",
                                 "dims=5 8 4 x",
                                 "dims",
                                 "dims=1152921504606846976 8 4 6",
                                 "space=1 2",
                                 "space=1 1 3",
                                 "space=3 2 1",
                                 "space=1 2 4",
                                 "space=-1 2 3",
                                 "start=5 0 0 0",
                                 "start=3 1 0 0",
                                 "start=3 0 0",
                                 "start=-1 0 0 0",

                                 "chunk=1 4 4",
                                 "chunk=1 4 4 0",
                                 "chunk=1 1 1 1",
                                 "chunk",
                                 "type=<c8",
                                 "type=text",
                                 "filter=x",
                                 "filter=-1",
                                 "fill=01",
                                 "fill=010203040506070809",
                                 "fill=zz",
                                 "fill",
                                 "chunks=",
                                 "chunks=1000 1a4 0",
                                 "chunks=-,-,-,-,-",
                                 "chunks=1000,-,-,-",
                                 "chunks=-1000 1 0,-,-,-",
                                 "chunks=1000 0 0,-,-,-",
                                 "chunks=1000 100000000 0,-,-,-",
                                 "chunks=1 1 1 1,-,-,-",
                                 "colour=red"}) {
    SCOPED_TRACE(text);
    Texts texts = With(text);
    if (absl::StartsWith(text, "colour")) {
      texts.emplace_back(text);
    }
    Hdf5ChunkTable table;
    bool is_complete = false;
    EXPECT_FALSE(AddHdf5Chunks(texts, &table, &is_complete) && is_complete);
  }
}

}  // namespace
}  // namespace isoscope::source
