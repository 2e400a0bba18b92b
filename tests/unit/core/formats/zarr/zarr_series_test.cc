#include "core/formats/zarr/zarr_series.h"

#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/zip_writer.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Objects;
using ::isoscope::testing::OpenSeries;
using ::isoscope::testing::PlainArray;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::WrittenChunks;
using ::isoscope::testing::Zarr2Text;
using ::isoscope::testing::Zarr3Group;
using ::isoscope::testing::Zarr3Text;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Two channels, two times, two levels.
Objects Image() {
  Objects objects = {
      {"zarr.json", Zarr3Group(R"({"ome": {"version": "0.5", "multiscales": [{"axes": [
          {"name": "t", "type": "time"}, {"name": "c", "type": "channel"},
          {"name": "z", "type": "space"}, {"name": "y", "type": "space"},
          {"name": "x", "type": "space"}], "datasets": [
          {"path": "s0", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 1, 1, 1]}]},
          {"path": "s1", "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2, 2, 2]},
             {"type": "translation", "translation": [0, 0, 0.5, 0.5, 0.5]}]}]}],
          "omero": {"channels": [{"label": "DAPI"}, {"label": "GFP"}]}}})")}};
  const std::string codecs =
      R"([{"name": "bytes", "configuration": {"endian": "little"}}, "gzip"])";
  objects["s0/zarr.json"] = Zarr3Text({2, 2, 4, 6, 8}, {1, 1, 3, 4, 5}, "uint16", "", codecs);
  objects["s1/zarr.json"] = Zarr3Text({2, 2, 2, 3, 4}, {1, 1, 2, 3, 4}, "uint16", "", codecs);
  const WrittenChunks fine{
      .chunk_dims = {1, 1, 3, 4, 5}, .encode = testing::Gzip, .fill = std::string(2, '\0')};
  const WrittenChunks coarse{
      .chunk_dims = {1, 1, 2, 3, 4}, .encode = testing::Gzip, .fill = std::string(2, '\0')};
  testing::AddChunks("s0", PlainArray::Counting({2, 2, 4, 6, 8}, 2), fine, true, &objects);
  testing::AddChunks("s1", PlainArray::Counting({2, 2, 2, 3, 4}, 2), coarse, true, &objects);
  return objects;
}

std::string WriteStore(const testing::TempDir& dir, const std::string& name,
                       const Objects& objects) {
  for (const auto& [key, bytes] : objects) {
    dir.Write(absl::StrCat(name, "/", key), bytes);
  }
  return dir.Sub(name);
}

TEST(ZarrSeriesTest, OpensFieldsStepsAndLevels) {
  const PlainArray fine = PlainArray::Counting({2, 2, 4, 6, 8}, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenSeries(Image()));
  ASSERT_EQ(series->info().fields.size(), 2U);
  EXPECT_THAT(series->info().fields_elsewhere, ElementsAre("s1"));
  for (int channel = 0; channel < 2; ++channel) {
    for (int step = 0; step < 2; ++step) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(channel, 0, step));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 3));
      EXPECT_EQ(samples, fine.Cut({.begin = {step, channel, 0, 0, 0},
                                   .end = {step + 1, channel + 1, 4, 6, 8}},
                                  ""));
    }
  }
  for (const char* part : {"GFP", "s0:GFP"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto gfp, OpenSeries(Image(), part));
    ASSERT_EQ(gfp->info().fields.size(), 1U);
    EXPECT_EQ(gfp->info().fields[0].name, "GFP");
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto level, OpenSeries(Image(), "s1"));
  EXPECT_EQ(level->info().fields.size(), 2U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto coarse, level->Open(1, 0, 1));
  EXPECT_EQ(coarse->info().geometry.spacing, (math::Vec3d{2, 2, 2}));
  EXPECT_EQ(coarse->info().geometry.origin, (math::Vec3d{0.5, 0.5, 0.5}));
  EXPECT_EQ(coarse->info().note, "");
  EXPECT_THAT(OpenSeries(Image(), "Cy5"), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(OpenSeries(Image(), "s7/x"), StatusIs(absl::StatusCode::kNotFound));
}

TEST(ZarrSeriesTest, OpensOneArrayOfAGroup) {
  Objects objects = {
      {".zgroup", "{\"zarr_format\": 2}"},
      {"g/.zgroup", "{\"zarr_format\": 2}"},
      {"g/a/.zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "|u1", ", \"fill_value\": 7")},
      {"g/b/.zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "|u1", ", \"fill_value\": 9")}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto both, OpenSeries(objects, "g"));
  EXPECT_EQ(both->info().fields.size(), 2U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, OpenSeries(objects, "g/b"));
  ASSERT_EQ(one->info().fields.size(), 1U);
  EXPECT_EQ(one->info().fields[0].name, "b");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, one->Open(0, 0, 0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*volume, 1));
  EXPECT_EQ(samples, std::string(24, '\x09'));  // no chunk is there
}

// Symptom: of arrays on two grids the first ones were served, without a word about the others.
TEST(ZarrSeriesTest, ArraysOnAnotherGridAreNamedWithThePathThatOpensThem) {
  const auto array = [](int size) {
    return Zarr2Text({size, 3, 4}, {size, 3, 4}, "|u1", ", \"fill_value\": 7");
  };
  Objects objects = {{".zgroup", "{\"zarr_format\": 2}"}, {"g/.zgroup", "{\"zarr_format\": 2}"},
                     {"g/a/.zarray", array(2)},           {"g/b/.zarray", array(2)},
                     {"g/fine/.zarray", array(5)},        {"g/mask/.zarray", array(5)}};
  const auto note_of = [&](const std::string& part) {
    const auto series = OpenSeries(objects, part);
    const auto volume = series.ok() ? (*series)->Open(0, 0, 0) : series.status();
    return volume.ok() ? (*volume)->info().note : volume.status().ToString();
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenSeries(objects, "g"));
  const std::string name = series->info().name;
  EXPECT_EQ(note_of("g"), absl::StrCat("\"g/fine\", \"g/mask\" lie on other grids: open ", name,
                                       ":g/fine, or another of them"));
  objects.erase("g/mask/.zarray");
  EXPECT_EQ(note_of("g"), absl::StrCat("\"g/fine\" lies on another grid: open ", name, ":g/fine"));
  // Who has chosen needs no advice.
  for (const char* const part : {"g/a", "g:a", "g/fine"}) {
    EXPECT_EQ(note_of(part), "") << part;
  }
  for (int i = 0; i < 9; ++i) {
    objects[absl::StrCat("g/z", i, "/.zarray")] = array(6 + i);
  }
  EXPECT_THAT(note_of("g"), HasSubstr("\"g/z3\" and 5 more lie on other grids: open "));
  // Levels of an image are no news.
  objects = Image();
  EXPECT_EQ(note_of(""), "");
}

TEST(ZarrSeriesTest, FindsStoresByPath) {
  const testing::TempDir dir;
  const std::string root = WriteStore(dir, "a:b/scan.zarr", Image());
  const auto find = [](const std::string& path) {
    const auto found = FindZarrPath(path);
    return found.has_value() ? absl::StrCat(found->file, " ", found->part) : "none";
  };
  EXPECT_EQ(find(root), root + " ");
  EXPECT_EQ(find(root + "/"), root + " ");
  EXPECT_EQ(find(root + ":s1"), root + " s1");
  EXPECT_EQ(find(root + ":s1:GFP"), root + " s1:GFP");
  EXPECT_EQ(find(root + "/s1"), root + " s1");
  EXPECT_EQ(find(root + "/s1:GFP"), root + " s1:GFP");
  EXPECT_EQ(find(root + "/zarr.json"), root + " ");
  EXPECT_EQ(find(root + "/s1/zarr.json"), root + " s1");
  EXPECT_EQ(find(root + "/s1/c"), "none");
  EXPECT_EQ(find(dir.path()), "none");
  EXPECT_EQ(find(dir.Sub("x.zarr")), "none");
  EXPECT_TRUE(IsZarrFolder(root));
  EXPECT_FALSE(IsZarrFolder(dir.path()));
}

TEST(ZarrSeriesTest, ListsTheFilesThatDecide) {
  const testing::TempDir dir;
  const std::string root = WriteStore(dir, "scan.zarr", Image());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfZarr(root, "s1", ""));
  EXPECT_THAT(files, ElementsAre(root + "/s1/c/0/0/0/0/0", root + "/s1/c/0/1/0/0/0",
                                 root + "/s1/c/1/0/0/0/0", root + "/s1/c/1/1/0/0/0",
                                 root + "/s1/zarr.json", root + "/zarr.json"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto finest, FilesOfZarr(root, "", ""));
  EXPECT_EQ(finest.size(), 2U + 32U);
  EXPECT_THAT(FilesOfZarr(root, "s0/none", ""), StatusIs(absl::StatusCode::kNotFound));
}

// Of a store of many arrays on one grid, as xarray writes it, a command that draws one does not look
// at the files of all, and a change of another one is none of it.
TEST(ZarrSeriesTest, ListsTheFilesOfOneFieldOfAGroup) {
  const testing::TempDir dir;
  const std::string root =
      WriteStore(dir, "run.zarr",
                 {{".zgroup", "{\"zarr_format\": 2}"},
                  {"a/.zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "|u1")},
                  {"a/.zattrs", "{\"_ARRAY_DIMENSIONS\": [\"z\", \"y\", \"x\"]}"},
                  {"a/0.0.0", std::string(24, 'a')},
                  {"b/.zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "|u1")},
                  {"b/.zattrs", "{\"_ARRAY_DIMENSIONS\": [\"z\", \"y\", \"x\"]}"},
                  {"b/0.0.0", std::string(24, 'b')},
                  {"z/.zarray", Zarr2Text({2}, {2}, "|u1")},
                  {"z/.zattrs", "{\"_ARRAY_DIMENSIONS\": [\"z\"]}"},
                  {"z/0", std::string("\x01\x03")}});
  const std::vector<std::string> of_b = {
      root + "/.zgroup",   root + "/b/.zarray", root + "/b/.zattrs", root + "/b/0.0.0",
      root + "/z/.zarray", root + "/z/.zattrs", root + "/z/0"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfZarr(root, "b", ""));
  EXPECT_EQ(files, of_b);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, FilesOfZarr(root, "", ""));
  EXPECT_EQ(all.size(), of_b.size() + 3);
}

TEST(ZarrSeriesTest, ListsTheFilesOfAStep) {
  const testing::TempDir dir;
  Objects objects = Image();
  const std::string root = WriteStore(dir, "scan.zarr", objects);
  const auto files_of = [&](int step) -> std::vector<std::string> {
    auto store = OpenLocalZarr(root);
    auto series = OpenZarrSeries(*std::move(store), "s1", "");
    auto files = (*series)->FilesOfStep(step);
    return files.ok() && files->has_value() ? **files : std::vector<std::string>{"none"};
  };
  EXPECT_THAT(files_of(0), ElementsAre(root + "/s1/c/0/0/0/0/0", root + "/s1/c/0/1/0/0/0",
                                       root + "/s1/zarr.json", root + "/zarr.json"));
  EXPECT_THAT(files_of(1), ElementsAre(root + "/s1/c/1/0/0/0/0", root + "/s1/c/1/1/0/0/0",
                                       root + "/s1/zarr.json", root + "/zarr.json"));
  // Chunks of two steps each: a file counts for both. One that is no chunk counts for all.
  dir.Write("scan.zarr/s1/zarr.json", Zarr3Text({2, 2, 2, 3, 4}, {2, 1, 2, 3, 4}, "uint16"));
  dir.Write("scan.zarr/s1/c/0/x", "?");
  EXPECT_THAT(files_of(1),
              ElementsAre(root + "/s1/c/0/0/0/0/0", root + "/s1/c/0/1/0/0/0", root + "/s1/c/0/x",
                          root + "/s1/zarr.json", root + "/zarr.json"));
  // Without steps, and in memory, all files count.
  dir.Write("one.zarr/.zarray", Zarr2Text({2, 3, 4}, {2, 3, 4}, "<u2"));
  auto one = OpenZarrSeries(*OpenLocalZarr(dir.Sub("one.zarr")), "", "");
  ISOSCOPE_ASSERT_OK(one);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, (*one)->FilesOfStep(0));
  EXPECT_FALSE(all.has_value());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto in_memory, OpenSeries(objects));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, in_memory->FilesOfStep(0));
  EXPECT_FALSE(none.has_value());
}

TEST(ZarrSeriesTest, NamesLabels) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto store,
      testing::OpenObjects(
          {{"zarr.json", Zarr3Group(R"({"ome": {"multiscales": [{"axes": ["z", "y", "x"],
                "datasets": [{"path": "0"}]}], "image-label": {"colors": [{"label-value": 2,
                "rgba": [1, 2, 3, 255]}]}}})")},
           {"0/zarr.json", Zarr3Text({2, 3, 4}, {2, 3, 4}, "uint16")}}));
  for (const char* part : {"", "0"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto labels, ZarrLabelsOf(store.get(), part));
    ASSERT_EQ(labels.size(), 1U);
    EXPECT_EQ(labels[0].color, (volume::LabelColor{.red = 1, .green = 2, .blue = 3}));
  }
}

TEST(ZarrSeriesTest, OpensArchives) {
  const testing::TempDir dir;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected_series, OpenSeries(Image(), "GFP"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto expected, expected_series->Open(0, 0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string samples, ReadAll(*expected, 1));
  for (const std::string folder : {"", "scan.zarr/"}) {
    for (const bool is_deflated : {false, true}) {
      testing::ZipWriter zip;
      // What zarr-python writes again stands in the archive twice: the last one counts.
      for (const auto& [key, bytes] : Image()) {
        zip.Add(folder + key, bytes.substr(0, bytes.size() / 2) + "{", !is_deflated);
      }
      for (const auto& [key, bytes] : Image()) {
        zip.Add(folder + key, bytes, is_deflated);
      }
      const std::string path = dir.Write("scan.ozx", zip.Finish());
      EXPECT_TRUE(IsZarrArchive(path));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto store, OpenLocalZarr(path));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenZarrSeries(std::move(store), "GFP", ""));
      EXPECT_EQ(series->info().name, path);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 1));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
      EXPECT_EQ(read, samples);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfZarr(path, "GFP", ""));
      EXPECT_THAT(files, ElementsAre(path));
    }
  }
  testing::ZipWriter other;
  other.Add("readme.txt", "hello", false);
  EXPECT_THAT(OpenLocalZarr(dir.Write("other.zip", other.Finish())),
              StatusIs(kInvalid, HasSubstr("without a Zarr store")));
  EXPECT_FALSE(IsZarrArchive(dir.Sub("other.zip")));
  EXPECT_THAT(OpenLocalZarr(dir.Write("bad.zip", "PK")), StatusIs(kInvalid));
  EXPECT_FALSE(IsZarrArchive(dir.Sub("bad.zip")));
  EXPECT_FALSE(IsZarrArchive(dir.Sub("none.zip")));
}

}  // namespace
}  // namespace isoscope::source
