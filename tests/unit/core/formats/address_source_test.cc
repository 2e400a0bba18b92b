// The same files are opened on the disk and at an address: both give the same volumes.

#include "core/formats/address_source.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/base/process_interrupt.h"
#include "core/formats/address_opening.h"
#include "core/formats/find_volume.h"
#include "core/formats/open_request.h"
#include "core/formats/source_labels.h"
#include "core/io/file.h"
#include "core/source/bytes/box_rows.h"
#include "core/source/bytes/raw_file.h"
#include "core/source/source_stamps.h"
#include "tests/support/folder_test.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"
#include "tests/support/zip_writer.h"
#include "tests/unit/core/formats/arrays/npy_bytes.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::IsSupersetOf;
using ::testing::Not;
using testing::ServedConnection;
using testing::ServedRequest;
using ::testing::SizeIs;
using ::testing::StartsWith;
using testing::StatusIs;
using ::testing::UnorderedElementsAre;

constexpr math::Index3 kDims{37, 29, 23};
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Serves the files below the test's folder.
class AddressSourceTest : public testing::FolderTest {
 protected:
  AddressSourceTest()
      : server_([this](const ServedRequest& request, ServedConnection* connection) {
          Serve(request, connection);
        }) {}

  void Serve(const ServedRequest& request, ServedConnection* connection) {
    const std::string path = request.target.substr(0, request.target.find('?'));
    const auto bytes = io::ReadWholeFile(dir_.Sub(path.substr(1)), 1 << 28);
    if (!bytes.ok() || LiesAbout(path)) {
      connection->Send(testing::Answer(404, "", "<html>no such thing</html>"));
    } else if (!knows_ranges_) {
      connection->Send(testing::Answer(200, "ETag: \"v1\"\r\n", *bytes));
    } else {
      testing::ServeObject({.bytes = *bytes, .etag = Etag()}, request, connection);
    }
  }

  void SetEtag(std::string etag) {
    const base::MutexLock lock(&mutex_);
    etag_ = std::move(etag);
  }
  std::string Etag() {
    const base::MutexLock lock(&mutex_);
    return etag_;
  }

  // A server that says once that it has not this chunk, or these attributes.
  bool LiesAbout(const std::string& path) {
    const base::MutexLock lock(&mutex_);
    return lies_once_ && (absl::StrContains(path, "/c/") || absl::EndsWith(path, "/.zattrs")) &&
           lies_.insert(path).second;
  }

  std::string At(const std::string& path) const {
    return absl::StrCat(server_.origin(), "/", path);
  }

  // All samples of the first volume, behind what its source says.
  static absl::StatusOr<std::string> WholeOf(const OpenRequest& request) {
    const auto series = Open(request);
    if (!series.ok()) {
      return series.status();
    }
    auto source = (*series)->Open(0, 0, 0);
    if (!source.ok()) {
      return source.status();
    }
    const auto samples = testing::ReadAll(**source, 5);
    if (!samples.ok()) {
      return samples.status();
    }
    const SourceInfo& info = (*source)->info();
    const auto& g = info.geometry;
    return absl::StrCat(g.sample_dims.x, " ", g.sample_dims.y, " ", g.sample_dims.z, " ",
                        g.spacing.x, " ", g.spacing.y, " ", g.spacing.z, " ", g.origin.x, " ",
                        volume::NameOf(info.type), " ", (*series)->info().fields[0].name, "\n",
                        *samples);
  }

  void ExpectEqual(const std::string& path, OpenRequest request = {}) {
    SCOPED_TRACE(path);
    request.path = dir_.Sub(path);
    const auto local = WholeOf(request);
    ASSERT_THAT(local.status(), IsOk());
    request.path = At(path);
    const auto remote = WholeOf(request);
    ASSERT_THAT(remote.status(), IsOk());
    EXPECT_TRUE(*local == *remote);
  }

  // What was asked for since the last call.
  std::vector<std::string> TakeTargets() {
    std::vector<std::string> targets;
    const std::vector<ServedRequest> requests = server_.requests();
    for (; taken_ < requests.size(); ++taken_) {
      targets.push_back(
          absl::StrCat(requests[taken_].target, " ", requests[taken_].Header("range")));
    }
    return targets;
  }

  void WriteObjects(const std::string& folder, const testing::Objects& objects) {
    for (const auto& [key, bytes] : objects) {
      dir_.Write(absl::StrCat(folder, "/", key), bytes);
    }
  }

  static absl::Status StatusOfOpen(const std::string& path) {
    return WholeOf({.path = path}).status();
  }

  void WriteZarr(const std::string& name) { WriteObjects(name, ZarrObjects()); }
  static testing::Objects ZarrObjects() {
    testing::Objects objects = {{"zarr.json", testing::Zarr3Group()}};
    objects["a/zarr.json"] = testing::Zarr3Text({23, 29, 37}, {8, 16, 16}, "uint16");
    testing::AddChunks("a", testing::PlainArray::Counting({23, 29, 37}, 2),
                       {.chunk_dims = {8, 16, 16}, .fill = std::string(2, '\0')}, true, &objects);
    return objects;
  }

  std::string samples_ = testing::Noise(kDims, volume::ScalarType::kUint16);
  std::atomic<bool> knows_ranges_ = true;
  std::atomic<bool> lies_once_ = false;
  base::Mutex mutex_;
  std::string etag_ ABSL_GUARDED_BY(mutex_) = "\"v1\"";
  std::set<std::string> lies_ ABSL_GUARDED_BY(mutex_);
  std::size_t taken_ = 0;  // requests
  testing::ScriptedServer server_;
};

TEST_F(AddressSourceTest, HeadersAndSamplesAreThoseOfTheFile) {
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  dir_.Write("a.mha", testing::MetaHeader(kDims, "MET_USHORT", "LOCAL") + samples_);
  dir_.Write("a.nii", testing::NiftiHeaderBytes({.dims = kDims, .datatype = 512}) + samples_);
  dir_.Write("without_ending", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  dir_.Write("a.npy", testing::NpyBytes("<u2", "(23, 29, 37)", samples_));
  dir_.Write("a.vti",
             testing::VtiBytes({.extent = "0 36 0 28 0 22",
                                .fields = {{.name = "p", .type = "UInt16", .samples = samples_}}}));
  for (const char* const path :
       {"a.nrrd", "a.mha", "a.nii", "without_ending", "a.npy", "a.vti", "a.vti:p"}) {
    ExpectEqual(path);
  }
}

TEST_F(AddressSourceTest, ARawFileIsReadByRanges) {
  dir_.Write("a b.raw", std::string(7, 'h') + samples_);
  OpenRequest request{
      .path = At("a%20b.raw"),
      .raw = RawFormat{.dims = kDims, .type = volume::ScalarType::kUint16, .header_bytes = 7}};
  dir_.Write("a%20b.raw", std::string(7, 'h') + samples_);  // the script decodes nothing
  const auto remote = WholeOf(request);
  ASSERT_THAT(remote.status(), IsOk());
  EXPECT_TRUE(absl::EndsWith(*remote, samples_));
  request.raw->dims.z += 1;
  EXPECT_THAT(WholeOf(request).status(), StatusIs(kInvalid, HasSubstr("the file has")));
}

TEST_F(AddressSourceTest, PagesOfTiffAreThoseOfTheFile) {
  ASSERT_TRUE(testing::WriteTiffStack(dir_.Sub("a.tif"), {.width = 300, .height = 40, .pages = 9}));
  ASSERT_TRUE(
      testing::WriteTiffStack(dir_.Sub("b.tif"), {.width = 30, .height = 20, .mode = "wb8"}));
  for (const char* const path : {"a.tif", "b.tif"}) {
    ExpectEqual(path);
  }
  dir_.Write("cut.tif", testing::ReadFile(dir_.Sub("a.tif")).substr(0, 5000));
  EXPECT_FALSE(StatusOfOpen(At("cut.tif")).ok());
}

// The library runs in a child process, which has no network.
TEST_F(AddressSourceTest, DatasetsOfHdf5AreThoseOfTheFile) {
  const std::string path = dir_.Sub("a.h5");
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(file, "whole", {23, 29, 37}, H5T_STD_U16LE, samples_.data());
  testing::WriteHdf5Dataset(file, "chunked", {23, 29, 37}, H5T_STD_U16LE, samples_.data(),
                            {8, 8, 8});
  // Names of files of this machine.
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  dir_.Write("local.raw", samples_);
  H5Pset_external(properties, dir_.Sub("local.raw").c_str(), 0, samples_.size());
  const hsize_t dims[3] = {23, 29, 37};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  H5Dclose(
      H5Dcreate2(file, "external", H5T_STD_U16LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Sclose(space);
  H5Pclose(properties);
  const std::string other = dir_.Sub("other.h5");
  const hid_t other_file = H5Fcreate(other.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(other_file, "d", {23, 29, 37}, H5T_STD_U16LE, samples_.data());
  H5Fclose(other_file);
  H5Lcreate_external(other.c_str(), "/d", file, "linked", H5P_DEFAULT, H5P_DEFAULT);
  H5Fclose(file);
  dir_.Write("plain_name", testing::ReadFile(path));
  for (const char* const part : {"a.h5:/whole", "a.h5:/chunked", "plain_name:/whole"}) {
    ExpectEqual(part);
  }
  for (const char* const part : {":/external", ":/linked"}) {
    EXPECT_THAT(StatusOfOpen(path + part), IsOk()) << part;
    EXPECT_FALSE(StatusOfOpen(At("a.h5") + part).ok()) << part;
  }
  EXPECT_THAT(StatusOfOpen(At("a.h5:/external")), StatusIs(kInvalid, HasSubstr("in other files")));
  const auto files = FilesOf({.path = At("a.h5:/whole")});
  ASSERT_THAT(files.status(), IsOk());
  EXPECT_THAT(*files, ::testing::ElementsAre(At("a.h5")));
  // A server that fails in the middle is an error of its own.
  dir_.Write("cut.h5", testing::ReadFile(path).substr(0, 4000));
  EXPECT_FALSE(StatusOfOpen(At("cut.h5:/whole")).ok());
}

// This process reads chunks and rows by ranges; the library, in its child, only lists them.
TEST_F(AddressSourceTest, BoxesOfHdf5AreThoseOfTheFile) {
  const std::string path = dir_.Sub("a.h5");
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(file, "whole", {23, 29, 37}, H5T_STD_U16LE, samples_.data());
  testing::WriteHdf5Dataset(file, "chunked", {23, 29, 37}, H5T_STD_U16LE, samples_.data(),
                            {8, 9, 10});
  H5Fclose(file);
  for (const bool is_chunked : {false, true}) {
    const auto series = Open({.path = At(is_chunked ? "a.h5:/chunked" : "a.h5:/whole")});
    ASSERT_THAT(series.status(), IsOk());
    const auto source = (*series)->Open(0, 0, 0);
    ASSERT_THAT(source.status(), IsOk());
    EXPECT_EQ((*source)->box_grid()->box_dims,
              is_chunked ? (math::Index3{10, 9, 8}) : FarRowBoxDims(kDims, 2));
    std::string box(samples_.size(), '?');
    ASSERT_THAT(
        (*source)->ReadBox({.begin = {0, 0, 0}, .end = kDims}, box.data(), base::Cancellation()),
        IsOk());
    EXPECT_TRUE(box == samples_);
    const auto rows = testing::ReadAll(**source, 7);
    ASSERT_THAT(rows.status(), IsOk());
    EXPECT_TRUE(*rows == samples_);
  }
}

// A classic file, whose library reads files of the disk alone.
TEST_F(AddressSourceTest, ClassicNetcdfNeedsACopy) {
  dir_.Write("a.nc", std::string("CDF\x01", 4) + std::string(28, '\0'));
  EXPECT_THAT(StatusOfOpen(At("a.nc")),
              StatusIs(kInvalid, ::testing::AllOf(HasSubstr("classic file of netCDF"),
                                                  HasSubstr("isoscope copy " + At("a.nc")))));
}

TEST_F(AddressSourceTest, OnlyTheHeaderIsReadForInfo) {
  const math::Index3 large{256, 256, 64};
  dir_.Write("large.nrrd", testing::NrrdHeader(large, "uint8", "raw") +
                               testing::Noise(large, volume::ScalarType::kUint8));
  const auto series = Open({.path = At("large.nrrd")});
  ASSERT_THAT(series.status(), IsOk());
  ASSERT_THAT((*series)->Open(0, 0, 0).status(), IsOk());
  // The block that opens it.
  EXPECT_THAT(TakeTargets(), ElementsAre("/large.nrrd bytes=0-65535"));
}

// Text headers may have more than a block.
TEST_F(AddressSourceTest, LongHeadersAreReadToTheirEnd) {
  const std::string comment = absl::StrCat("# ", std::string(1000, 'x'), "\n");
  std::string comments;
  for (int i = 0; i < 200; ++i) {
    comments += comment;
  }
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw", comments) + samples_);
  const std::string header = testing::MetaHeader(kDims, "MET_USHORT", "LOCAL");
  const std::size_t second = header.find('\n') + 1;
  dir_.Write("a.mha", absl::StrCat(header.substr(0, second), "Comment = ", std::string(70'000, 'x'),
                                   "\n", header.substr(second), samples_));
  ExpectEqual("a.nrrd");
  ExpectEqual("a.mha");
}

TEST_F(AddressSourceTest, PlanesOfVtiAreReadAtOnce) {
  const math::Index3 large{256, 256, 32};
  const std::string samples = testing::Noise(large, volume::ScalarType::kUint8);
  dir_.Write("a.vti",
             testing::VtiBytes({.extent = "0 255 0 255 0 31",
                                .fields = {{.name = "p", .type = "UInt8", .samples = samples}}}));
  const auto series = Open({.path = At("a.vti")});
  ASSERT_THAT(series.status(), IsOk());
  const auto source = (*series)->Open(0, 0, 0);
  ASSERT_THAT(source.status(), IsOk());
  TakeTargets();
  // Half of each plane: stretches of 32 KiB, which a request takes with what lies between them.
  constexpr std::int64_t kHalfPlane = 256 * 128;
  std::string box(static_cast<std::size_t>(32 * kHalfPlane), '?');
  ASSERT_THAT((*source)->ReadBox({.begin = {0, 128, 0}, .end = {256, 256, 32}}, box.data(),
                                 base::Cancellation()),
              IsOk());
  for (std::size_t z = 0; z < 32; ++z) {
    EXPECT_TRUE(box.substr(z * kHalfPlane, kHalfPlane) ==
                samples.substr((2 * z + 1) * kHalfPlane, kHalfPlane))
        << z;
  }
  EXPECT_THAT(TakeTargets(), SizeIs(1));
}

// Files, volumes and labels are looked for one after the other, each from the root on.
TEST_F(AddressSourceTest, AnOpeningAsksForMetadataOnce) {
  WriteZarr("run.zarr");
  {
    const AddressOpening opening;
    ASSERT_THAT(OpenIdentified({.path = At("run.zarr:a")}).status(), IsOk());
    ASSERT_THAT(ReadSourceLabels(At("run.zarr:a")).status(), IsOk());
  }
  EXPECT_THAT(
      TakeTargets(),
      UnorderedElementsAre("/run.zarr/zarr.json ", "/run.zarr/.zarray ", "/run.zarr/.zgroup ",
                           "/run.zarr/.zattrs ", "/run.zarr/.zmetadata ", "/run.zarr/a/zarr.json ",
                           "/run.zarr/a/.zarray ", "/run.zarr/a/.zgroup ", "/run.zarr/a/.zattrs "));
}

TEST_F(AddressSourceTest, AnOpeningAsksForLevelsAndLabelsTogether) {
  const std::string axes = R"([{"name": "z", "type": "space"}, {"name": "y", "type": "space"},
      {"name": "x", "type": "space"}])";
  const auto level = [](const std::string& path, int scale) {
    return absl::StrCat("{\"path\": \"", path,
                        R"(", "coordinateTransformations": [{"type": "scale", "scale": [)", scale,
                        ", ", scale, ", ", scale, "]}]}");
  };
  testing::Objects objects = {
      {"zarr.json", testing::Zarr3Group(absl::StrCat(
                        R"({"ome": {"version": "0.5", "multiscales": [{"axes": )", axes,
                        ", \"datasets\": [", level("0", 1), ", ", level("1", 2), "]}]}}"))},
      {"0/zarr.json", testing::Zarr3Text({8, 8, 8}, {8, 8, 8}, "uint16")},
      {"1/zarr.json", testing::Zarr3Text({4, 4, 4}, {4, 4, 4}, "uint16")}};
  WriteObjects("run.zarr", objects);
  ASSERT_THAT(OpenIdentified({.path = At("run.zarr")}).status(), IsOk());
  const std::vector<std::string> targets = TakeTargets();
  EXPECT_THAT(targets, SizeIs(7));  // five of the root
  EXPECT_THAT(targets, IsSupersetOf({"/run.zarr/0/zarr.json ", "/run.zarr/labels/zarr.json "}));
}

// Each field of the group is on the axes of the others.
TEST_F(AddressSourceTest, AnOpeningAsksForCoordinatesOnce) {
  testing::Objects objects = {{"zarr.json", testing::Zarr3Group()}};
  for (const char* const field : {"t", "u"}) {
    objects[absl::StrCat(field, "/zarr.json")] = testing::Zarr3Text(
        {4, 4, 4}, {4, 4, 4}, "uint16", R"(, "dimension_names": ["z", "y", "x"])");
  }
  std::string nodes;
  for (const char* const axis : {"z", "y", "x"}) {
    objects[absl::StrCat(axis, "/zarr.json")] = testing::Zarr3Text(
        {4}, {4}, "float64", absl::StrCat(R"(, "dimension_names": [")", axis, "\"]"));
    objects[absl::StrCat(axis, "/c/0")] = testing::NumberText<double>({0, 1, 2, 3});
  }
  for (const auto& [key, text] : objects) {
    if (const std::size_t slash = key.find("/zarr.json"); slash != std::string::npos) {
      absl::StrAppend(&nodes, nodes.empty() ? "" : ", ", "\"", key.substr(0, slash), "\": ", text);
    }
  }
  objects["zarr.json"] = absl::StrCat(
      R"({"zarr_format": 3, "node_type": "group", "consolidated_metadata": {"metadata": {)", nodes,
      "}}}");
  WriteObjects("run.zarr", objects);
  ASSERT_THAT(OpenIdentified({.path = At("run.zarr")}).status(), IsOk());
  const std::vector<std::string> targets = TakeTargets();
  EXPECT_THAT(targets, SizeIs(8));  // five of the root
  EXPECT_THAT(targets, IsSupersetOf({"/run.zarr/z/c/0 ", "/run.zarr/y/c/0 ", "/run.zarr/x/c/0 "}));
}

TEST_F(AddressSourceTest, TheNextOpeningSeesWhatHasChanged) {
  WriteZarr("run.zarr");
  std::unique_ptr<VolumeSeries> series;
  {
    const AddressOpening opening;
    auto opened = OpenIdentified({.path = At("run.zarr:a")});
    ASSERT_THAT(opened.status(), IsOk());
    series = *std::move(opened);
  }
  const auto sample = [&] {
    auto source = series->Open(0, 0, 0);
    std::string bytes(2, '?');
    EXPECT_THAT((*source)->ReadBox({.begin = {0, 0, 0}, .end = {1, 1, 1}}, bytes.data(),
                                   base::Cancellation()),
                IsOk());
    return bytes;
  };
  // Samples are never kept, however small their chunks are.
  dir_.Write("run.zarr/a/c/0/0/0", std::string(8 * 16 * 16 * 2, '\1'));
  EXPECT_EQ(sample(), "\1\1");
  dir_.Write("run.zarr/a/c/0/0/0", std::string(8 * 16 * 16 * 2, '\2'));
  EXPECT_EQ(sample(), "\2\2");
  dir_.Write("run.zarr/a/zarr.json", testing::Zarr3Text({8, 16, 16}, {8, 16, 16}, "uint16"));
  const auto again = Open({.path = At("run.zarr:a")});
  ASSERT_THAT(again.status(), IsOk());
  const auto source = (*again)->Open(0, 0, 0);
  ASSERT_THAT(source.status(), IsOk());
  EXPECT_EQ((*source)->info().geometry.sample_dims, (math::Index3{16, 16, 8}));
}

TEST_F(AddressSourceTest, AStoreOfZarrIsAFolderWithoutAList) {
  WriteZarr("run.zarr");
  WriteZarr("plain");
  WriteZarr("with.dot");
  for (const char* const path : {"run.zarr:a", "run.zarr/a", "plain:a", "with.dot:a"}) {
    SCOPED_TRACE(path);
    const auto local = WholeOf({.path = dir_.Sub(path)});
    const auto remote = WholeOf({.path = At(path)});
    ASSERT_THAT(local.status(), IsOk());
    ASSERT_THAT(remote.status(), IsOk());
    EXPECT_TRUE(*local == *remote);
  }
}

// Breaks if the first word is taken: such a chunk would have the fill value, and the picture be wrong.
TEST_F(AddressSourceTest, AChunkIsMissingIfTheServerSaysSoTwice) {
  testing::Objects objects = ZarrObjects();
  ASSERT_EQ(objects.erase("a/c/1/0/1"), 1U);
  WriteObjects("run.zarr", objects);
  lies_once_ = true;
  ExpectEqual("run.zarr:a");
  const base::MutexLock lock(&mutex_);
  EXPECT_THAT(lies_, SizeIs(3 * 2 * 3 - 1));  // all chunks that are there
}

TEST_F(AddressSourceTest, AttributesOfZarr2AreMissingIfTheServerSaysSoTwice) {
  dir_.Write("old.zarr/.zgroup", R"({"zarr_format": 2})");
  dir_.Write("old.zarr/a/.zarray", R"({"zarr_format": 2, "shape": [2, 2, 2], "chunks": [2, 2, 2],
      "dtype": "|u1", "order": "C", "fill_value": 0, "filters": null, "compressor": null})");
  dir_.Write("old.zarr/a/.zattrs", R"({"scale_factor": 0.5, "add_offset": 3})");
  dir_.Write("old.zarr/a/0.0.0", "abcdefgh");
  lies_once_ = true;
  ExpectEqual("old.zarr:a");
  const base::MutexLock lock(&mutex_);
  EXPECT_THAT(lies_, SizeIs(1));
}

TEST_F(AddressSourceTest, AZippedStoreIsReadByRanges) {
  testing::ZipWriter zip;
  for (const auto& [key, bytes] : ZarrObjects()) {
    zip.Add(key, bytes, /*is_deflated=*/false);
  }
  dir_.Write("run.zip", zip.Finish());
  dir_.Write("run.ozx", zip.Finish());
  ExpectEqual("run.zip:a");
  ExpectEqual("run.ozx:a");
}

TEST_F(AddressSourceTest, StampsOfAStoreTellNotAll) {
  WriteZarr("run.zarr");
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  const auto files = FilesOf({.path = At("run.zarr:a")});
  ASSERT_THAT(files.status(), IsOk());
  EXPECT_THAT(*files, Contains(At("run.zarr/zarr.json")));
  EXPECT_THAT(*files, Contains(At("run.zarr/a/zarr.json")));
  EXPECT_FALSE(StampsTellAll(*files));
  const auto before = StampsOf(*files);
  ASSERT_THAT(before.status(), IsOk());
  dir_.Write("run.zarr/zarr.json", testing::Zarr3Group(R"({"changed": 1})"));
  ASSERT_THAT(FilesOf({.path = At("run.zarr:a")}).status(), IsOk());
  EXPECT_NE(*StampsOf(*files), *before);

  const auto one = FilesOf({.path = At("a.nrrd")});
  ASSERT_THAT(one.status(), IsOk());
  EXPECT_TRUE(StampsTellAll(*one));
  EXPECT_THAT(*StampsOf(*one), HasSubstr("\"v1\""));
}

TEST_F(AddressSourceTest, AnObjectWithoutAVersionTellsNotAll) {
  SetEtag("");
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  const auto files = FilesOf({.path = At("a.nrrd")});
  ASSERT_THAT(files.status(), IsOk());
  EXPECT_FALSE(StampsTellAll(*files));
}

TEST_F(AddressSourceTest, AnObjectThatChangesIsNoMixture) {
  const math::Index3 large{256, 256, 64};
  dir_.Write("b.nrrd", testing::NrrdHeader(large, "uint8", "raw") +
                           testing::Noise(large, volume::ScalarType::kUint8));
  SetEtag("\"w1\"");
  const auto other = Open({.path = At("b.nrrd")});
  ASSERT_THAT(other.status(), IsOk());
  auto volume = (*other)->Open(0, 0, 0);
  ASSERT_THAT(volume.status(), IsOk());
  SetEtag("\"w2\"");
  EXPECT_THAT(testing::ReadAll(**volume, 64).status(), StatusIs(absl::StatusCode::kDataLoss));
}

TEST_F(AddressSourceTest, WhatNeedsTheWholeFileSaysSo) {
  const std::string header = testing::NrrdHeader(kDims, "uint16", "gzip");
  dir_.Write("a.nrrd", header + testing::Gzip(samples_));
  dir_.Write("a.nii.gz",
             testing::Gzip(testing::NiftiHeaderBytes({.dims = kDims, .datatype = 512}) + samples_));
  dir_.Write("a.dcm", std::string(128, '\0') + "DICM");
  for (const char* const path : {"a.nrrd", "a.nii.gz", "a.dcm"}) {
    EXPECT_THAT(StatusOfOpen(At(path)),
                StatusIs(kInvalid, AllOf(HasSubstr("whole file"),
                                         HasSubstr(absl::StrCat("isoscope copy ", At(path))))))
        << path;
  }
}

// A file from elsewhere must not name files of this machine.
TEST_F(AddressSourceTest, NoNameInAFileLeadsToAnother) {
  dir_.Write("a.raw", samples_);
  for (const std::string& name : {std::string("a.raw"), dir_.Sub("a.raw"), At("a.raw")}) {
    dir_.Write("a.nhdr", testing::NrrdHeader(kDims, "uint16", "raw",
                                             absl::StrCat("data file: ", name, "\n")));
    dir_.Write("a.mhd", testing::MetaHeader(kDims, "MET_USHORT", name));
    for (const char* const path : {"a.nhdr", "a.mhd"}) {
      EXPECT_THAT(StatusOfOpen(At(path)), StatusIs(kInvalid, HasSubstr("in another file")))
          << path << " " << name;
    }
  }
  dir_.Write("a.vti",
             testing::VtiBytes({.extent = "0 36 0 28 0 22",
                                .fields = {{.name = "p", .type = "UInt16", .samples = samples_}}}));
  dir_.Write("a.pvd",
             absl::StrCat("<?xml version=\"1.0\"?><VTKFile type=\"Collection\"><Collection>"
                          "<DataSet timestep=\"0\" file=\"",
                          dir_.Sub("a.vti"), "\"/></Collection></VTKFile>"));
  EXPECT_THAT(StatusOfOpen(dir_.Sub("a.pvd")), IsOk());
  EXPECT_THAT(StatusOfOpen(At("a.pvd")), StatusIs(kInvalid, HasSubstr("lists other files")));
  dir_.Write("p.img", samples_);
  dir_.Write("p.hdr", testing::NiftiHeaderBytes({.dims = kDims, .datatype = 512, .is_pair = true}));
  EXPECT_FALSE(StatusOfOpen(At("p.img")).ok());
  EXPECT_FALSE(StatusOfOpen(At("p.hdr")).ok());
}

TEST_F(AddressSourceTest, WhatIsNotThereIsSaidOnce) {
  EXPECT_THAT(StatusOfOpen(At("none.nrrd")),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(StartsWith(At("none.nrrd")), HasSubstr("neither an object nor"))));
  const int count = server_.request_count();
  EXPECT_THAT(StatusOfOpen(At("none.nrrd")), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_EQ(server_.request_count(), count);
  EXPECT_THAT(StatusOfOpen(At("none.zarr")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no Zarr store")));
}

TEST_F(AddressSourceTest, AServerWithoutRangesIsRefusedByName) {
  knows_ranges_ = false;
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  EXPECT_THAT(StatusOfOpen(At("a.nrrd")),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("ranges")));
  // Chunks are whole objects.
  WriteZarr("run.zarr");
  EXPECT_THAT(StatusOfOpen(At("run.zarr:a")), IsOk());
}

TEST_F(AddressSourceTest, NoTextHasTheQuery) {
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  const std::string secret = "c2VjcmV0";
  const std::string address = At("a.nrrd?X-Amz-Signature=") + secret;
  const auto path = PathOfSource(address);
  ASSERT_THAT(path.status(), IsOk());
  EXPECT_EQ(*path, At("a.nrrd"));
  const OpenRequest request{.path = address};
  const auto series = OpenIdentified(request);
  ASSERT_THAT(series.status(), IsOk());
  EXPECT_THAT((*series)->info().name, Not(HasSubstr(secret)));
  EXPECT_THAT(*(*series)->IdentityOfStep(0), Not(HasSubstr(secret)));
  EXPECT_THAT(*Describe(request), Not(HasSubstr(secret)));
  EXPECT_THAT(*FilesOf(request), Each(Not(HasSubstr(secret))));
  const std::vector<ServedRequest> requests = server_.requests();
  EXPECT_TRUE(std::all_of(requests.begin(), requests.end(), [&](const ServedRequest& r) {
    return absl::StrContains(r.target, secret);
  }));
  // Another address of the same path would be read as the first.
  EXPECT_THAT(PathOfSource(At("a.nrrd?id=2")).status(),
              StatusIs(kInvalid, AllOf(HasSubstr("another query"), Not(HasSubstr(secret)))));
  EXPECT_THAT(PathOfSource("https://ada:" + secret + "@host/x").status(),
              StatusIs(kInvalid, Not(HasSubstr(secret))));
  EXPECT_EQ(*PathOfSource("/data/a.nrrd"), "/data/a.nrrd");
}

TEST_F(AddressSourceTest, StampsTellQueriesApart) {
  dir_.Write("one", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  dir_.Write("two", testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
  const auto version = [&](const std::string& address) {
    const auto files = FilesOf({.path = address});
    const auto stamps = files.ok() ? StampsOf(*files) : files.status();
    EXPECT_THAT(stamps.status(), IsOk());
    return stamps.ok() ? stamps->substr(stamps->find('\n')) : "";
  };
  const std::string plain = version(At("one"));
  EXPECT_NE(version(At("two?id=1")), plain);
}

TEST_F(AddressSourceTest, LabelsAreReadOfTheHeader) {
  dir_.Write("a.nrrd", testing::NrrdHeader(kDims, "uint16", "raw",
                                           "Segment0_LabelValue:=3\nSegment0_Name:=Kidney\n") +
                           samples_);
  const auto labels = ReadSourceLabels(At("a.nrrd"));
  ASSERT_THAT(labels.status(), IsOk());
  const auto local = ReadSourceLabels(dir_.Sub("a.nrrd"));
  ASSERT_THAT(local.status(), IsOk());
  EXPECT_EQ(labels->size(), local->size());
}

// The server does not answer for one file until it is released.
class StalledAddressTest : public AddressSourceTest {
 protected:
  StalledAddressTest()
      : stalled_server_([this](const ServedRequest& request, ServedConnection* connection) {
          if (request.target == "/slow.nrrd") {
            base::MutexLock lock(&mutex_);
            has_request_ = true;
            changed_.SignalAll();
            changed_.Await(&mutex_,
                           [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return is_released_; });
          }
          Serve(request, connection);
        }) {
    for (const char* const name : {"slow.nrrd", "quick.nrrd"}) {
      dir_.Write(name, testing::NrrdHeader(kDims, "uint16", "raw") + samples_);
    }
  }
  ~StalledAddressTest() override { Release(); }

  absl::Status Find(const std::string& name) {
    const auto path = PathOfSource(absl::StrCat(stalled_server_.origin(), "/", name));
    return path.ok() ? FindAtAddress(*path).status() : path.status();
  }
  void AwaitRequest() {
    base::MutexLock lock(&mutex_);
    changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return has_request_; });
  }
  void Release() {
    base::MutexLock lock(&mutex_);
    is_released_ = true;
    changed_.SignalAll();
  }
  int RequestsOf(const std::string& target) {
    const std::vector<ServedRequest> requests = stalled_server_.requests();
    return static_cast<int>(
        std::count_if(requests.begin(), requests.end(),
                      [&](const ServedRequest& request) { return request.target == target; }));
  }

  base::Mutex mutex_;
  base::CondVar changed_;
  bool has_request_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_released_ ABSL_GUARDED_BY(mutex_) = false;
  testing::ScriptedServer stalled_server_;
};

TEST_F(StalledAddressTest, OtherAddressesAreFoundMeanwhile) {
  std::vector<absl::Status> answers(3);
  std::vector<std::thread> threads;
  threads.emplace_back([&] { answers[0] = Find("slow.nrrd"); });
  AwaitRequest();
  EXPECT_THAT(Find("quick.nrrd"), IsOk());
  EXPECT_THAT(Find("none.nrrd"), StatusIs(absl::StatusCode::kNotFound));
  for (std::size_t i = 1; i < answers.size(); ++i) {
    threads.emplace_back([&answers, i, this] { answers[i] = Find("slow.nrrd"); });
  }
  Release();
  for (std::thread& thread : threads) {
    thread.join();
  }
  for (const absl::Status& answer : answers) {
    EXPECT_THAT(answer, IsOk());
  }
  EXPECT_EQ(RequestsOf("/slow.nrrd"), RequestsOf("/quick.nrrd"));
}

TEST_F(StalledAddressTest, TheInterruptEndsThoseWhoWait) {
  base::Cancellation interrupt;
  base::SetProcessInterrupt(&interrupt);
  std::vector<absl::Status> answers(3);
  std::vector<std::thread> threads;
  for (absl::Status& answer : answers) {
    threads.emplace_back([&answer, this] { answer = Find("slow.nrrd"); });
  }
  AwaitRequest();
  interrupt.Cancel();
  for (std::thread& thread : threads) {
    thread.join();
  }
  base::SetProcessInterrupt(nullptr);
  for (const absl::Status& answer : answers) {
    EXPECT_THAT(answer, StatusIs(absl::StatusCode::kCancelled));
  }
}

}  // namespace
}  // namespace isoscope::source
