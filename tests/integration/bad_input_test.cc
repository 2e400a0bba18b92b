// Everything a user or a disk can get wrong: each case has its exit code and a message that says
// what, where, the actual value and what was expected. Never a crash, never a wrong picture.

#include <algorithm>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/units.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::AnyOf;
using testing::CommandResult;
using ::testing::HasSubstr;
using testing::Join;
using testing::RunIsoscope;
using testing::StatusIs;

constexpr int kFailed = 1;
constexpr int kWrongUsage = 2;
constexpr int kInterrupted = 130;
constexpr std::int64_t kMaxFileBytes = 64 * base::kMiB;

// One bad command: its exit code, and what its one line on standard error must say.
void ExpectFailure(const std::vector<std::string>& arguments, int exit_code,
                   const std::vector<std::string>& expected_parts,
                   const testing::ProcessOptions& options = {}) {
  const CommandResult result = RunIsoscope(arguments, options);
  SCOPED_TRACE(::testing::PrintToString(arguments));
  EXPECT_EQ(result.exit_code, exit_code) << result.err;
  for (const std::string& part : expected_parts) {
    EXPECT_THAT(result.err, HasSubstr(part));
  }
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1)
      << "not one line: " << result.err;
  EXPECT_EQ(result.out, "");
}

class BadInputTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    ISOSCOPE_ASSERT_OK(
        testing::MakeDataset(testing::GyroidVolume({25, 21, 17}), shared_->Sub("good"), 2, 8));
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }

  // A sound dataset, not to be changed.
  static std::string GoodDataset() { return shared_->Sub("good"); }
  [[nodiscard]] std::string Path(const std::string& name) const { return directory_.Sub(name); }
  [[nodiscard]] testing::ProcessOptions Options() const {
    return {.environment = {"XDG_CACHE_HOME=" + cache_.path()}};
  }
  void Write(const std::string& name, const std::string& bytes) const {
    ISOSCOPE_ASSERT_OK(io::WriteWholeFile(Path(name), bytes));
  }
  // Everything in the test's folder, hidden names too.
  [[nodiscard]] std::vector<std::string> Entries() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(directory_.path())) {
      names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }
  // `render` of the good dataset with more flags.
  [[nodiscard]] std::vector<std::string> RenderGood(const std::vector<std::string>& flags) const {
    return Join({"render", GoodDataset(), "--output", Path("p.png"), "--renderer", "cpu"}, flags);
  }

  static testing::TempDir* shared_;
  testing::TempDir directory_;
  testing::TempDir cache_;  // Mesa keeps its shaders there, too
};

testing::TempDir* BadInputTest::shared_ = nullptr;

TEST_F(BadInputTest, UnreadableOrTruncatedVolumes) {
  const std::string header =
      "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 10 10 10\nencoding: raw\n\n";
  Write("short.nrrd", header + std::string(999, 'x'));
  Write("cut_header.nrrd", header.substr(0, 40));
  Write("text.nrrd", "this is no volume\n");
  Write("empty.nii", "");
  Write("empty.nii.gz", "");
  Write("unknown.xyz", "abc");
  Write("cut.nii.gz", std::string("\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03\x63", 11));
  Write("huge.nrrd",
        "NRRD0004\ntype: double\ndimension: 3\nsizes: 2000000000 2000000000 2000000000\n"
        "endian: little\nencoding: raw\n\nabc");
  Write("gzip.nrrd",
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 10 10 10\nencoding: gzip\n\nnot gzip at all");
  Write("detached.nhdr",
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: gone.raw\n");
  const auto partition = [&](const std::string& name) {
    return std::vector<std::string>{"partition", Path(name), "--output", Path("out")};
  };
  const std::vector<std::string> before = Entries();
  ExpectFailure(partition("short.nrrd"), kFailed,
                {"INVALID_ARGUMENT", "short.nrrd", "10 x 10 x 10", "need 1065 bytes", "has 1064"});
  ExpectFailure(partition("cut_header.nrrd"), kFailed, {"INVALID_ARGUMENT", "cut_header.nrrd"});
  ExpectFailure(partition("text.nrrd"), kFailed, {"INVALID_ARGUMENT", "text.nrrd", "NRRD"});
  ExpectFailure(partition("empty.nii"), kFailed, {"empty.nii"});
  ExpectFailure(partition("empty.nii.gz"), kFailed, {"empty.nii.gz"});
  ExpectFailure(partition("cut.nii.gz"), kFailed, {"cut.nii.gz"});
  ExpectFailure(partition("huge.nrrd"), kFailed, {"INVALID_ARGUMENT", "huge.nrrd", "2000000000"});
  ExpectFailure(partition("gzip.nrrd"), kFailed, {"gzip.nrrd"});
  ExpectFailure(partition("detached.nhdr"), kFailed, {"detached.nhdr", "gone.raw"});
  ExpectFailure(partition("unknown.xyz"), kFailed, {"INVALID_ARGUMENT", "unknown.xyz", "--dims"});
  ExpectFailure(partition("absent.nrrd"), kFailed, {"NOT_FOUND", "absent.nrrd"});
  ExpectFailure({"partition", directory_.path(), "--output", Path("out")}, kFailed,
                {directory_.path(), "folder"});
  // Straight to a picture: the same, and no picture.
  ExpectFailure({"render", Path("short.nrrd"), "--isovalue", "1", "--output", Path("p.png")},
                kFailed, {"INVALID_ARGUMENT", "short.nrrd", "has 1064"}, Options());
  ExpectFailure({"export", Path("absent.nrrd"), "--isovalue", "1", "--output", Path("p.ply")},
                kFailed, {"NOT_FOUND", "absent.nrrd"}, Options());
  EXPECT_EQ(Entries(), before) << "something was left behind";
}

TEST_F(BadInputTest, RawFilesWhoseFlagsAreWrong) {
  Write("v.raw", std::string(1000, 'x'));
  const auto partition = [&](const std::vector<std::string>& flags) {
    return Join({"partition", Path("v.raw"), "--output", Path("out")}, flags);
  };
  ExpectFailure(partition({"--dims", "10,10,11", "--type", "uint8"}), kFailed,
                {"INVALID_ARGUMENT", "v.raw", "10 x 10 x 11", "1100", "1000"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--header-bytes", "1"}),
                kFailed, {"INVALID_ARGUMENT", "v.raw", "1001", "1000"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint16"}), kFailed,
                {"INVALID_ARGUMENT", "2000", "1000"});
  // One sample on an axis has no cell. Whether it is found with the flag or with the file, it says
  // which value is wrong and what is right.
  for (const char* dims : {"1,10,100", "10,1,100", "10,100,1"}) {
    const CommandResult result = RunIsoscope(partition({"--dims", dims, "--type", "uint8"}));
    EXPECT_THAT(result.exit_code, AnyOf(kFailed, kWrongUsage)) << dims;
    EXPECT_THAT(result.err, AllOf(HasSubstr("1"), HasSubstr("2"))) << dims;
    EXPECT_FALSE(io::PathExists(Path("out")));
  }
  ExpectFailure(partition({"--dims", "0,10,10", "--type", "uint8"}), kWrongUsage, {"0,10,10"});
  ExpectFailure(partition({"--dims", "10,10", "--type", "uint8"}), kWrongUsage, {"10,10"});
  ExpectFailure(partition({"--dims", "10,10,10,", "--type", "uint8"}), kWrongUsage, {"10,10,10,"});
  ExpectFailure(partition({"--dims", "99999999999999999999,2,2", "--type", "uint8"}), kWrongUsage,
                {"99999999999999999999"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "float16"}), kWrongUsage,
                {"float16", "float32"});
  ExpectFailure(partition({"--dims", "10,10,10"}), kWrongUsage, {"--type"});
  ExpectFailure(partition({"--type", "uint8"}), kWrongUsage, {"--dims"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--spacing", "0,1,1"}),
                kWrongUsage, {"0,1,1"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--spacing", "nan,1,1"}),
                kWrongUsage, {"nan,1,1"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--origin", "inf,1,1"}),
                kWrongUsage, {"inf,1,1"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--endian", "middle"}),
                kWrongUsage, {"middle", "little"});
  // 729 cells: 8 blocks of 8 cells.
  ExpectFailure(
      partition({"--dims", "10,10,10", "--type", "uint8", "--block-cells", "8", "--shards", "9"}),
      kFailed, {"INVALID_ARGUMENT", "9 shards", "8 blocks"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--shards", "0"}), kWrongUsage,
                {"0"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--block-cells", "129"}),
                kWrongUsage, {"129", "128"});
  ExpectFailure(partition({"--dims", "10,10,10", "--type", "uint8", "--memory-limit", "1"}),
                kFailed, {"INVALID_ARGUMENT", "memory limit 1 ", "--memory-limit"});
  EXPECT_EQ(Entries(), std::vector<std::string>{"v.raw"}) << "something was left behind";
}

TEST_F(BadInputTest, OutputsThatExistOrCannotBeWritten) {
  const testing::TestVolume volume = testing::GyroidVolume({25, 21, 17});
  ISOSCOPE_ASSERT_OK(testing::WriteRawFile(volume, Path("v.raw")));
  fs::create_directory(Path("folder"));
  const auto partition = [&](const std::string& output) {
    return Join({"partition", Path("v.raw"), "--output", output}, testing::RawFlags(volume));
  };
  ExpectFailure(partition(Path("folder")), kFailed, {"ALREADY_EXISTS", Path("folder")});
  ExpectFailure(partition(Path("v.raw")), kFailed, {"ALREADY_EXISTS", Path("v.raw")});
  ExpectFailure(partition(Path("no/such/parent")), kFailed, {"NOT_FOUND", Path("no/such")});
  EXPECT_TRUE(fs::is_empty(Path("folder")));
  ExpectFailure({"render", GoodDataset(), "--isovalue", "128", "--output", Path("folder")}, kFailed,
                {"FAILED_PRECONDITION", Path("folder")});
  ExpectFailure({"render", GoodDataset(), "--isovalue", "128", "--output", Path("none/p.png")},
                kFailed, {"NOT_FOUND", Path("none/p.png")});
  ExpectFailure({"export", GoodDataset(), "--surface", "128:1,1,1:0.5", "--output", Path("p.ply")},
                2, {"--surface 128 has opacity 0.5", "meshes are opaque"});
  ExpectFailure({"export", GoodDataset(), "--isovalue", "128", "--output", Path("none/p.ply")},
                kFailed, {"NOT_FOUND", Path("none/p.ply")});
  EXPECT_EQ(Entries(), (std::vector<std::string>{"folder", "v.raw"}));
}

TEST_F(BadInputTest, FullDiskLeavesNothing) {
  const testing::TestVolume volume = testing::GyroidVolume({65, 65, 65});
  ISOSCOPE_ASSERT_OK(testing::WriteRawFile(volume, Path("v.raw")));
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(volume, Path("d"), 1, 16));
  const std::vector<std::string> before = Entries();
  // The child's files can't grow beyond this; writes then fail as on a full disk.
  const testing::ProcessOptions full{.environment = Options().environment,
                                     .max_file_bytes = 20'000};
  ExpectFailure(
      Join({"partition", Path("v.raw"), "--output", Path("out")}, testing::RawFlags(volume)),
      kFailed, {"RESOURCE_EXHAUSTED", "blocks.bin", "out"}, full);
  EXPECT_EQ(Entries(), before);
  ExpectFailure(
      {"render", Path("d"), "--isovalue", "128", "--output", Path("p.png"), "--renderer", "cpu"},
      kFailed, {"RESOURCE_EXHAUSTED", "p.png"}, full);
  EXPECT_EQ(Entries(), before);
  ExpectFailure({"export", Path("d"), "--isovalue", "128", "--output", Path("m.ply"), "-q"},
                kFailed, {"RESOURCE_EXHAUSTED", "m.ply"}, full);
  EXPECT_EQ(Entries(), before);
  // A device that is full.
  ExpectFailure(
      {"render", Path("d"), "--isovalue", "128", "--output", "/dev/full", "--renderer", "cpu"},
      kFailed, {"/dev/full"});
  EXPECT_EQ(Entries(), before);
}

TEST_F(BadInputTest, RequestsThatCanNotBeRight) {
  const auto iso = [](const char* value) { return std::vector<std::string>{"--isovalue", value}; };
  ExpectFailure(RenderGood(iso("nan")), kWrongUsage, {"--isovalue", "nan", "number"});
  ExpectFailure(RenderGood(iso("inf")), kWrongUsage, {"--isovalue", "inf", "number"});
  ExpectFailure(RenderGood(iso("1e999")), kWrongUsage, {"--isovalue", "1e999"});
  ExpectFailure(RenderGood(iso("12x")), kWrongUsage, {"--isovalue", "12x"});
  ExpectFailure(RenderGood({}), kWrongUsage, {"--isovalue"});
  const auto with = [&](const std::vector<std::string>& flags) {
    return RenderGood(Join({"--isovalue", "128"}, flags));
  };
  ExpectFailure(with({"--width", "0"}), kWrongUsage, {"--width", "0", "65536"});
  ExpectFailure(with({"--height", "100000"}), kWrongUsage, {"--height", "100000", "65536"});
  ExpectFailure(with({"--width", "-5"}), kWrongUsage, {"-5"});
  ExpectFailure(with({"--fov-y", "0"}), kWrongUsage, {"--fov-y", "'0'", "180"});
  ExpectFailure(with({"--fov-y", "180"}), kWrongUsage, {"--fov-y", "'180'", "below 180"});
  ExpectFailure(with({"--fov-y", "nan"}), kWrongUsage, {"nan"});
  ExpectFailure(with({"--eye", "1,2,3", "--target", "1,2,3"}), kFailed,
                {"INVALID_ARGUMENT", "1, 2, 3", "differ"});
  ExpectFailure(with({"--eye", "0,0,9", "--target", "0,0,0", "--up", "0,0,-2"}), kFailed,
                {"INVALID_ARGUMENT", "0, 0, -2", "parallel"});
  ExpectFailure(with({"--up", "0,0,0"}), kFailed, {"INVALID_ARGUMENT", "up"});
  ExpectFailure(with({"--eye", "1,inf,3"}), kWrongUsage, {"1,inf,3"});
  ExpectFailure(with({"--eye", "1,2"}), kWrongUsage, {"'1,2'"});
  ExpectFailure(with({"--zoom", "0"}), kWrongUsage, {"--zoom"});
  ExpectFailure(with({"--azimuth", "nan"}), kWrongUsage, {"nan"});
  ExpectFailure(with({"--culling", "some"}), kWrongUsage, {"some", "depth"});
  ExpectFailure(with({"--renderer", "gpu"}), kWrongUsage, {"gpu", "egl"});
  ExpectFailure(with({"--repeat", "0"}), kWrongUsage, {"0"});
  ExpectFailure(with({"--isovalues", "3"}), kWrongUsage, {"--isovalues"});
  ExpectFailure(with({"--shards", "3"}), kWrongUsage, {"--shards 3", "2"});
  ExpectFailure(with({"--server", "127.0.0.1:1"}), kWrongUsage, {"--server"});
  ExpectFailure(with({"--server", "non:sense"}), kWrongUsage, {"non:sense"});
  ExpectFailure({"render", "--server", "127.0.0.1:1", "--isovalue", "1", "--output", Path("p.png"),
                 "--timeout", "5"},
                kFailed, {"UNAVAILABLE", "127.0.0.1:1"});
  ExpectFailure({"info", Path("nothing")}, kFailed, {"NOT_FOUND", Path("nothing")});
  ExpectFailure({"serve", Path("nothing")}, kFailed, {"NOT_FOUND", Path("nothing")});
  ExpectFailure({"serve", GoodDataset(), "--listen", "127.0.0.1:99999"}, kWrongUsage, {"99999"});
  ExpectFailure({"rendre"}, kWrongUsage, {"rendre", "render"});
  ExpectFailure({}, kWrongUsage, {"command"});
  EXPECT_EQ(Entries(), std::vector<std::string>{}) << "a picture was written";
}

TEST_F(BadInputTest, IsovalueOutsideTheDataIsAnEmptyPicture) {
  for (const char* isovalue : {"-1e30", "1e30"}) {
    const CommandResult result =
        RunIsoscope(RenderGood({"--isovalue", isovalue, "--width", "40", "--height", "30"}));
    EXPECT_EQ(result.exit_code, 0) << result.err;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string png,
                                  io::ReadWholeFile(Path("p.png"), kMaxFileBytes));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage image, image::DecodePng(png));
    EXPECT_EQ(image.pixels, std::vector<image::Rgba8>(40 * 30, {0, 0, 0, 255}));
    const CommandResult mesh =
        RunIsoscope({"export", GoodDataset(), "--isovalue", isovalue, "--output", Path("m.ply")});
    EXPECT_EQ(mesh.exit_code, 0) << mesh.err;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string ply,
                                  io::ReadWholeFile(Path("m.ply"), kMaxFileBytes));
    EXPECT_THAT(ply, AllOf(HasSubstr("element vertex 0\n"), HasSubstr("element face 0\n")));
  }
}

TEST_F(BadInputTest, RequestsOnTheWireAreCheckedLikeFlags) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(GoodDataset(), 2));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const auto expect =
      [&](const char* what, absl::StatusCode code, const std::vector<std::string>& parts,
          const std::function<void(isoscope::v1::RenderIsosurfaceRequest*)>& spoil) {
        SCOPED_TRACE(what);
        isoscope::v1::RenderIsosurfaceRequest request = testing::SmallRequest();
        request.mutable_camera()->mutable_eye()->set_z(100);
        request.mutable_camera()->mutable_target();
        request.mutable_camera()->mutable_perspective()->set_fov_y_degrees(30);
        spoil(&request);
        const auto response = testing::Render(cluster->address(), request);
        EXPECT_THAT(response, StatusIs(code));
        for (const std::string& part : parts) {
          EXPECT_THAT(std::string(response.status().message()), HasSubstr(part));
        }
      };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  expect("isovalue nan", kInvalid, {"isovalue", "nan"}, [&](auto* r) { r->set_isovalue(nan); });
  expect("isovalue inf", kInvalid, {"isovalue", "inf"}, [&](auto* r) { r->set_isovalue(-inf); });
  expect("no viewport", kInvalid, {"viewport"}, [](auto* r) { r->clear_viewport(); });
  expect("width 0", kInvalid, {"viewport", "0", "16384"},
         [](auto* r) { r->mutable_viewport()->set_width_px(0); });
  expect("height 100000", kInvalid, {"viewport", "100000", "16384"},
         [](auto* r) { r->mutable_viewport()->set_height_px(100000); });
  expect("height -1", kInvalid, {"viewport", "-1"},
         [](auto* r) { r->mutable_viewport()->set_height_px(-1); });
  const auto set_region = [](isoscope::v1::RenderIsosurfaceRequest* r, int x, int y, int width,
                             int height) {
    r->mutable_region()->set_x(x);
    r->mutable_region()->set_y(y);
    r->mutable_region()->set_width_px(width);
    r->mutable_region()->set_height_px(height);
  };
  constexpr int kMaxInt = std::numeric_limits<int>::max();
  constexpr int kMinInt = std::numeric_limits<int>::min();
  struct BadRegion {
    int x, y, width, height;
    std::vector<std::string> parts;
  };
  // Regions of a viewport of 40 x 30 pixels.
  for (const BadRegion& bad :
       std::vector<BadRegion>{{0, 0, 0, 0, {"region.width_px is 0", "[1, 40]"}},
                              {-1, 0, 1, 1, {"region.x is -1", "[0, 39]"}},
                              {40, 0, 1, 1, {"region.x is 40", "[0, 39]"}},
                              {0, 30, 1, 1, {"region.y is 30", "[0, 29]"}},
                              {0, kMinInt, 1, 1, {"region.y is -2147483648", "[0, 29]"}},
                              {39, 0, 2, 1, {"region.width_px is 2", "[1, 1]"}},
                              {10, 20, 5, 11, {"region.height_px is 11", "[1, 10]"}},
                              {1, 1, kMaxInt, 1, {"region.width_px is 2147483647", "[1, 39]"}},
                              {1, 1, 1, kMinInt, {"region.height_px is -2147483648", "[1, 29]"}}}) {
    expect("region", kInvalid, bad.parts, [&](auto* r) {
      r->mutable_viewport()->set_width_px(40);
      r->mutable_viewport()->set_height_px(30);
      set_region(r, bad.x, bad.y, bad.width, bad.height);
    });
  }
  expect("region without viewport", kInvalid, {"viewport"}, [&](auto* r) {
    r->clear_viewport();
    set_region(r, 0, 0, 1, 1);
  });
  expect("viewport of a region", kInvalid, {"viewport.width_px is 65537", "[1, 65536]"},
         [&](auto* r) {
           r->mutable_viewport()->set_width_px(65537);
           set_region(r, 0, 0, 1, 1);
         });
  expect("too large without a region", kInvalid, {"is 20000", "16384", "region", "65536"},
         [](auto* r) { r->mutable_viewport()->set_width_px(20000); });
  expect("region too large for a picture", kInvalid, {"region.width_px is 20000", "[1, 16384]"},
         [&](auto* r) {
           r->mutable_viewport()->set_width_px(20000);
           set_region(r, 0, 0, 20000, 1);
         });
  expect("eye is target", kInvalid, {"eye", "target"},
         [](auto* r) { r->mutable_camera()->mutable_eye()->set_z(0); });
  expect("eye inf", kInvalid, {"eye", "inf"},
         [&](auto* r) { r->mutable_camera()->mutable_eye()->set_x(inf); });
  expect("target nan", kInvalid, {"target", "nan"},
         [&](auto* r) { r->mutable_camera()->mutable_target()->set_y(nan); });
  expect("up parallel", kInvalid, {"up", "parallel"},
         [](auto* r) { r->mutable_camera()->mutable_up()->set_z(1); });
  expect("up 0", kInvalid, {"up"}, [](auto* r) { r->mutable_camera()->mutable_up(); });
  expect("no projection", kInvalid, {"projection"},
         [](auto* r) { r->mutable_camera()->clear_perspective(); });
  for (const double degrees : {0.0, 180.0, -1.0, nan, inf}) {
    expect("fov", kInvalid, {"fov_y_degrees", "180"}, [&](auto* r) {
      r->mutable_camera()->mutable_perspective()->set_fov_y_degrees(degrees);
    });
  }
  for (const double height : {0.0, -1.0, nan, inf}) {
    expect("height", kInvalid, {"height"},
           [&](auto* r) { r->mutable_camera()->mutable_orthographic()->set_height(height); });
  }
  expect("culling", kInvalid, {"culling", "77"},
         [](auto* r) { r->set_culling(static_cast<isoscope::v1::Culling>(77)); });
  expect("camera fit", kInvalid, {"camera_fit", "77"},
         [](auto* r) { r->set_camera_fit(static_cast<isoscope::v1::CameraFit>(77)); });
  expect("camera fit below 0", kInvalid, {"camera_fit", "-1"},
         [](auto* r) { r->set_camera_fit(static_cast<isoscope::v1::CameraFit>(-1)); });
  expect("colour", kInvalid, {"base_color"}, [](auto* r) { r->mutable_base_color()->set_red(7); });
  expect("colour nan", kInvalid, {"background_color"}, [](auto* r) {
    r->mutable_background_color()->set_red(std::numeric_limits<float>::quiet_NaN());
  });
  expect("unknown dataset", absl::StatusCode::kNotFound, {"\"other\"", "\"good\""},
         [](auto* r) { r->set_dataset("other"); });
  // After all of it the server still serves.
  ISOSCOPE_EXPECT_OK(testing::Render(cluster->address(), testing::SmallRequest()));
}

TEST_F(BadInputTest, HistogramRequestsOnTheWireAreChecked) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster,
                                testing::ProcessCluster::Start(GoodDataset(), 2));
  const auto stub = isoscope::v1::DatasetService::NewStub(rpc::MakeChannel(cluster->address()));
  const auto ask =
      [&](const std::function<void(isoscope::v1::GetHistogramRequest*)>& change) -> absl::Status {
    isoscope::v1::GetHistogramRequest request;
    change(&request);
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    isoscope::v1::GetHistogramResponse response;
    return rpc::ToAbslStatus(stub->GetHistogram(&context, request, &response));
  };
  const auto range = [](double min, double max) {
    return [min, max](isoscope::v1::GetHistogramRequest* request) {
      request->mutable_value_range()->set_min(min);
      request->mutable_value_range()->set_max(max);
    };
  };
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  for (const int count : {-1, 4097, std::numeric_limits<int>::min()}) {
    EXPECT_THAT(ask([&](auto* r) { r->set_max_bin_count(count); }),
                StatusIs(kInvalid, AllOf(HasSubstr("max_bin_count"), HasSubstr("4096"))));
  }
  for (const auto& [min, max] :
       {std::pair(kNan, 1.0), std::pair(0.0, kNan), std::pair(-kInfinity, 1.0),
        std::pair(0.0, kInfinity), std::pair(5.0, 4.0)}) {
    EXPECT_THAT(ask(range(min, max)), StatusIs(kInvalid, HasSubstr("value_range")));
  }
  EXPECT_THAT(ask(range(1e6, 1e300)), StatusIs(kInvalid, HasSubstr("no sample is in it")));
  EXPECT_THAT(ask([](auto* r) { r->set_dataset("other"); }),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("\"good\"")));
  EXPECT_THAT(ask([](auto* r) { r->GetReflection()->MutableUnknownFields(r)->AddVarint(99, 1); }),
              StatusIs(kInvalid, HasSubstr("99")));
  ISOSCOPE_EXPECT_OK(ask(range(-1e308, 1e308)));
  ISOSCOPE_EXPECT_OK(ask([](auto* r) { r->set_max_bin_count(1); }));
}

TEST_F(BadInputTest, CamerasThatAreNone) {
  Write("cut.json", "{\"eye\": [0, 0,");
  Write("nan.json",
        "{\"eye\": [0, 0, \"nan\"], \"target\": [0, 0, 0], \"orthographic\": {\"height\": 1}}");
  const std::vector<std::string> at{"--isovalue", "128"};
  ExpectFailure(RenderGood(Join(at, {"--camera", Path("none.json")})), kFailed,
                {"NOT_FOUND", "none.json"});
  ExpectFailure(RenderGood(Join(at, {"--camera", Path("cut.json")})), kFailed,
                {"INVALID_ARGUMENT", "cut.json", "JSON"});
  ExpectFailure(RenderGood(Join(at, {"--camera", Path("nan.json")})), kFailed,
                {"INVALID_ARGUMENT", "nan.json", "eye"});
  ExpectFailure(RenderGood(Join(at, {"--view", "anterior"})), kFailed,
                {"INVALID_ARGUMENT", "no patient frame", "front"});
  ExpectFailure(RenderGood(Join(at, {"--view", "upside-down"})), kWrongUsage,
                {"upside-down",
                 "front, back, left, right, top, bottom, anterior, posterior, superior, inferior"});
  ExpectFailure(RenderGood(Join(at, {"--fit", "nothing"})), kWrongUsage, {"volume, surface"});
  ExpectFailure(RenderGood(Join(at, {"--view", "top", "--eye", "1,2,3"})), kWrongUsage,
                {"--eye", "--view"});
  ExpectFailure(RenderGood(Join(at, {"--camera", "c.json", "--zoom", "2"})), kWrongUsage,
                {"--camera", "--zoom"});
  ExpectFailure(RenderGood(Join(at, {"--save-camera", "/no/such/folder/c.json"})), kFailed,
                {"/no/such/folder"});
  ExpectFailure({"info", GoodDataset(), "--bins", "9"}, kWrongUsage, {"--histogram"});
  ExpectFailure({"info", GoodDataset(), "--histogram", "--range", "2,1"}, kWrongUsage, {"2,1"});
  ExpectFailure({"info", GoodDataset(), "--histogram", "--bins", "4097"}, kWrongUsage, {"4096"});
  ExpectFailure({"info", GoodDataset(), "--histogram-svg", Path("h.svg")}, kWrongUsage,
                {"--histogram-svg"});
  ExpectFailure({"info", GoodDataset(), "--histogram", "--range", "5000,6000"}, kFailed,
                {"INVALID_ARGUMENT", "no sample is in it"});
}

// Changes one byte of a shard at a time, over all of its files; the files are tiny, so that header,
// index, samples and every page of the tree are met.
TEST_F(BadInputTest, DamagedShardIsAnErrorOrTheRightPictureNeverAnother) {
  const std::string dataset = Path("d");
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({13, 12, 11}), dataset, 2, 4));
  const std::string shard = testing::ShardDirectory(dataset, 1, 2);
  const auto render = [&] {
    fs::remove(Path("p.png"));
    return RunIsoscope({"render", dataset, "--isovalue", "128", "--output", Path("p.png"),
                        "--width", "48", "--height", "48", "--renderer", "cpu", "--threads", "1"});
  };
  const CommandResult sound = render();
  ASSERT_EQ(sound.exit_code, 0) << sound.err;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string right,
                                io::ReadWholeFile(Path("p.png"), kMaxFileBytes));
  int error_count = 0;
  std::vector<std::string> files;
  for (const auto& entry : fs::directory_iterator(shard)) {
    files.push_back(entry.path().string());
  }
  std::sort(files.begin(), files.end());
  ASSERT_EQ(files.size(), 7U);
  for (const std::string& file : files) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(file, kMaxFileBytes));
    ASSERT_FALSE(bytes.empty()) << file;
    const auto damage = [&](const std::string& what, const std::string& damaged) {
      SCOPED_TRACE(file + ": " + what);
      fs::remove(file);
      ISOSCOPE_ASSERT_OK(io::WriteWholeFile(file, damaged));
      const CommandResult result = render();
      if (result.exit_code == 0) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string picture,
                                      io::ReadWholeFile(Path("p.png"), kMaxFileBytes));
        EXPECT_TRUE(picture == right) << "another picture";
      } else {
        ++error_count;
        EXPECT_EQ(result.exit_code, kFailed) << result.err;
        EXPECT_THAT(result.err, AnyOf(HasSubstr("DATA_LOSS"), HasSubstr("FAILED_PRECONDITION"),
                                      HasSubstr("NOT_FOUND")));
        EXPECT_THAT(result.err, HasSubstr("shard")) << "does not name the shard";
        EXPECT_FALSE(io::PathExists(Path("p.png")));
      }
    };
    // Both ends, and places spread over the rest; odd steps so that no field is always missed.
    constexpr std::size_t kPlaces = 5;
    std::vector<std::size_t> offsets{0, bytes.size() - 1};
    for (std::size_t i = 1; i < kPlaces; ++i) {
      offsets.push_back(i * bytes.size() / kPlaces + i % 7 < bytes.size()
                            ? i * bytes.size() / kPlaces + i % 7
                            : bytes.size() / 2);
    }
    for (const std::size_t offset : offsets) {
      std::string damaged = bytes;
      damaged[offset] = static_cast<char>(damaged[offset] ^ (1 << offset % 8));
      damage(absl::StrCat("byte ", offset, " of ", bytes.size(), " flipped"), damaged);
    }
    damage("last byte cut off", bytes.substr(0, bytes.size() - 1));
    damage("cut in half", bytes.substr(0, bytes.size() / 2));
    damage("empty", "");
    damage("one byte too many", bytes + "x");
    fs::remove(file);
    ISOSCOPE_ASSERT_OK(io::WriteWholeFile(file, bytes));
    // A file that is gone.
    fs::rename(file, Path("away"));
    const CommandResult gone = render();
    if (fs::path(file).filename() == "histogram.bin") {  // no frame needs it
      EXPECT_EQ(gone.exit_code, 0) << gone.err;
    } else {
      EXPECT_EQ(gone.exit_code, kFailed) << file << ": " << gone.err;
      EXPECT_THAT(gone.err, HasSubstr("shard"));
    }
    fs::rename(Path("away"), file);
  }
  // Defends the test: nearly every byte is needed.
  EXPECT_GT(error_count, 6 * 6);
  const CommandResult again = render();
  EXPECT_EQ(again.exit_code, 0) << again.err;
}

// Damage after the agent has started: the frame fails and names the place; the agent lives on.
TEST_F(BadInputTest, ShardDamagedWhileServedIsDataLossThatNamesThePlace) {
  const std::string dataset = Path("d");
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({25, 21, 17}), dataset, 2, 8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cluster, testing::ProcessCluster::Start(dataset, 2));
  const std::string file = testing::ShardDirectory(dataset, 1, 2) + "/blocks.bin";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(file, kMaxFileBytes));
  const auto overwrite = [&](const std::string& content) {
    // In place: the agent holds the file open.
    std::FILE* out = std::fopen(file.c_str(), "r+b");
    ASSERT_NE(out, nullptr);
    EXPECT_EQ(std::fwrite(content.data(), 1, content.size(), out), content.size());
    EXPECT_EQ(std::fclose(out), 0);
  };
  isoscope::v1::RenderIsosurfaceRequest request = testing::SmallRequest();
  request.set_culling(isoscope::v1::CULLING_NONE);
  std::string damaged = bytes;
  for (std::size_t i = 0; i < damaged.size(); i += 64) {
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
  }
  overwrite(damaged);
  EXPECT_THAT(testing::Render(cluster->address(), request),
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr(cluster->agent_address(1)), HasSubstr("dataset d "),
                             HasSubstr("shard 1"), HasSubstr("block"), HasSubstr("offset"))));
  overwrite(bytes);
  ISOSCOPE_EXPECT_OK(testing::Render(cluster->address(), request));
}

TEST_F(BadInputTest, MissingShardIsNamed) {
  const std::string dataset = Path("d");
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({25, 21, 17}), dataset, 3, 8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess agent,
                                testing::StartAgent({testing::ShardDirectory(dataset, 0, 3),
                                                     testing::ShardDirectory(dataset, 2, 3)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      testing::ServerProcess coordinator,
      testing::StartCoordinator({agent.address}, {}, /*wait_until_ready=*/false));
  EXPECT_THAT(testing::Render(coordinator.address, testing::SmallRequest()),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("\"d\""), HasSubstr("shard 1 of 3"))));
  fs::remove_all(testing::ShardDirectory(dataset, 1, 3));
  ExpectFailure({"render", dataset, "--isovalue", "128", "--output", Path("p.png")}, kFailed,
                {"FAILED_PRECONDITION", dataset, "1 of its 3 shards (1)"});
}

TEST_F(BadInputTest, ShardsOfTwoDatasetsWithOneNameAreRefused) {
  fs::create_directory(Path("a"));
  fs::create_directory(Path("b"));
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({25, 21, 17}), Path("a/d"), 2, 8));
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({25, 21, 18}), Path("b/d"), 2, 8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess first,
                                testing::StartAgent({testing::ShardDirectory(Path("a/d"), 0, 2)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess second,
                                testing::StartAgent({testing::ShardDirectory(Path("b/d"), 1, 2)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      testing::ServerProcess coordinator,
      testing::StartCoordinator({first.address, second.address}, {}, /*wait_until_ready=*/false));
  EXPECT_THAT(testing::Render(coordinator.address, testing::SmallRequest()),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("\"d\""), HasSubstr(first.address),
                             HasSubstr(second.address), HasSubstr("contradict"))));
  // One agent with both refuses to start.
  EXPECT_THAT(testing::StartAgent({Path("a/d"), Path("b/d")}),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("two different ones")));
}

// Partitioning that is caught in the middle: it has begun to write, and stands still.
class InterruptedPartitionTest : public BadInputTest {
 protected:
  // A sparse file: 256 MiB of zeros that take no room but take time to cut.
  void Start() {
    Write("v.raw", "");
    fs::resize_file(Path("v.raw"), std::uintmax_t{1} << 28);
    const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
    do {  // again if it was done before it could be stopped
      process_ = nullptr;
      fs::remove_all(Path("out"));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(process_, testing::StartIsoscope(Arguments(), {}));
      while (Entries().size() < 2 && base::MonotonicNow() < deadline) {
        absl::SleepFor(absl::Milliseconds(1));
      }
      process_->Stop();
      ASSERT_EQ(Entries().size(), 2U);
    } while (io::PathExists(Path("out")) && base::MonotonicNow() < deadline);
    ASSERT_FALSE(io::PathExists(Path("out"))) << "it was done before it could be stopped";
  }
  [[nodiscard]] std::vector<std::string> Arguments() const {
    return {"partition",     Path("v.raw"), "--output",       Path("out"),
            "--shards",      "2",           "--dims",         "1024,512,512",
            "--type",        "uint8",       "--memory-limit", "64MiB",
            "--block-cells", "32"};
  }

  std::unique_ptr<testing::Process> process_;
};

TEST_F(InterruptedPartitionTest, CtrlCLeavesNothing) {
  ASSERT_NO_FATAL_FAILURE(Start());
  process_->Signal(SIGINT);
  process_->Signal(SIGCONT);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const int exit_code, process_->Wait(testing::kPatience));
  EXPECT_EQ(exit_code, kInterrupted);
  EXPECT_THAT(process_->err(), AllOf(HasSubstr("CANCELLED"), HasSubstr("interrupted")));
  EXPECT_EQ(Entries(), std::vector<std::string>{"v.raw"});
}

TEST_F(InterruptedPartitionTest, KillLeavesNothingThatOpensAndTheNextRunSucceeds) {
  ASSERT_NO_FATAL_FAILURE(Start());
  process_->Kill();
  EXPECT_FALSE(io::PathExists(Path("out")));
  for (const std::string& name : Entries()) {
    if (name != "v.raw") {
      ExpectFailure({"info", Path(name)}, kFailed, {name});
      ExpectFailure({"render", Path(name), "--isovalue", "1", "--output", Path("p.png")}, kFailed,
                    {name});
    }
  }
  // The next run, of a volume that is cut faster.
  const testing::TestVolume volume = testing::GyroidVolume({25, 21, 17});
  fs::remove(Path("v.raw"));
  ISOSCOPE_ASSERT_OK(testing::WriteRawFile(volume, Path("v.raw")));
  const CommandResult again = RunIsoscope(
      Join({"partition", Path("v.raw"), "--output", Path("out")}, testing::RawFlags(volume)));
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(RunIsoscope({"info", Path("out")}).exit_code, 0);
}

}  // namespace
}  // namespace isoscope
