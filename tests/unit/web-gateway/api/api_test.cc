// The HTTP interface in front of a coordinator of a script: what of its answers reaches users and
// caches.

#include "web-gateway/api/api.h"

#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "core/image/png_codec.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/web-gateway/header_of.h"

namespace isoscope::gateway {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using ::testing::Not;

class Cluster final : public v1::ClusterService::Service {
 public:
  grpc::Status GetClusterStatus(grpc::ServerContext* /*context*/,
                                const v1::GetClusterStatusRequest* /*request*/,
                                v1::GetClusterStatusResponse* response) override {
    *response = status;
    return grpc::Status::OK;
  }

  v1::GetClusterStatusResponse status;
};

class Datasets final : public v1::DatasetService::Service {
 public:
  grpc::Status ListDatasets(grpc::ServerContext* /*context*/,
                            const v1::ListDatasetsRequest* /*request*/,
                            v1::ListDatasetsResponse* response) override {
    *response->add_datasets() = Dataset();
    return grpc::Status::OK;
  }
  grpc::Status GetDataset(grpc::ServerContext* /*context*/, const v1::GetDatasetRequest* request,
                          v1::GetDatasetResponse* response) override {
    if (request->name() != "head" && request->name() != dataset_id) {
      return {grpc::StatusCode::NOT_FOUND, "as the coordinator says it"};
    }
    *response->mutable_dataset() = Dataset();
    response->set_picture_revision(picture_revision);
    return grpc::Status::OK;
  }
  grpc::Status GetHistogram(grpc::ServerContext* /*context*/,
                            const v1::GetHistogramRequest* request,
                            v1::GetHistogramResponse* response) override {
    if (request->has_selection()) {
      *response->mutable_selection() = request->selection();
    }
    return grpc::Status::OK;
  }

  std::string dataset_id = "0123";
  std::string picture_revision = "cpu 1";
  int step_count = 0;         // of two fields, if there are steps
  std::string later_samples;  // of the steps after the first

 private:
  [[nodiscard]] v1::Dataset Dataset() const {
    v1::Dataset dataset;
    dataset.set_name("head");
    dataset.set_dataset_id(dataset_id);
    v1::GridGeometry& geometry = *dataset.mutable_geometry();
    geometry.mutable_sample_dims()->set_x(9);
    geometry.mutable_sample_dims()->set_y(9);
    geometry.mutable_sample_dims()->set_z(9);
    geometry.mutable_spacing()->set_x(1);
    geometry.mutable_spacing()->set_y(1);
    geometry.mutable_spacing()->set_z(1);
    for (int step = 0; step < step_count; ++step) {
      v1::TimeStep& time = *dataset.add_time_steps();
      time.set_number(step);
      time.set_value(step * 0.5);
      time.set_volumes_digest(absl::StrCat("digest of step ", step, step > 0 ? later_samples : ""));
    }
    for (const char* const name : {"pressure", "velocity"}) {
      if (step_count == 0) {
        break;
      }
      v1::Field& field = *dataset.add_fields();
      field.set_name(name);
      v1::FieldComponent& component = *field.add_components();
      component.mutable_value_range()->set_max(step_count);
      for (int step = 0; step < step_count; ++step) {
        field.add_time_steps(step);
      }
    }
    return dataset;
  }
};

class Surfaces final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status RenderIsosurfaceStream(
      grpc::ServerContext* context, const v1::RenderIsosurfaceStreamRequest* request,
      grpc::ServerWriter<v1::RenderIsosurfaceStreamResponse>* writer) override {
    ++picture_count;
    requests.push_back(request->request());
    if (picture_count == endless_picture) {
      is_endless.Notify();
      while (!context->IsCancelled()) {
        absl::SleepFor(absl::Milliseconds(1));
      }
      return grpc::Status::CANCELLED;
    }
    if (picture_count >= refused_picture && refusal_count > 0) {
      --refusal_count;
      if (!was_refused.HasBeenNotified()) {
        was_refused.Notify();
      }
      return rpc::ToGrpcStatus(refusal);
    }
    v1::RenderIsosurfaceStreamResponse message;
    message.mutable_part()->set_png(png);
    *message.mutable_part()->mutable_camera() = camera;
    if (request->request().has_selection()) {
      *message.mutable_part()->mutable_selection() = request->request().selection();
      message.mutable_part()->set_time(request->request().selection().time_step() * 0.5);
    }
    writer->Write(message);
    return grpc::Status::OK;
  }

  std::string png = "a picture";
  v1::Camera camera;
  int picture_count = 0;
  std::vector<v1::RenderIsosurfaceRequest> requests;  // in order
  int endless_picture = 0;                            // the one that ends by cancellation alone
  absl::Notification is_endless;
  absl::Notification was_refused;
  int refused_picture = 0;  // the first one of those that are refused
  int refusal_count = 0;
  absl::Status refusal;
};

class ApiTest : public ::testing::Test {
 protected:
  void SetUp() override {
    v1::AgentStatus& agent = *cluster_.status.add_agents();
    agent.set_address("10.0.0.7:50052");
    agent.set_state(v1::AgentStatus::STATE_REACHABLE);
    grpc::ServerBuilder builder;
    builder.RegisterService(&cluster_);
    builder.RegisterService(&datasets_);
    builder.RegisterService(&surfaces_);
    server_ = builder.BuildAndStart();
    client_ = std::make_unique<CoordinatorClient>(
        CoordinatorClientOptions{.channel = server_->InProcessChannel({})});
    api_ = std::make_unique<Api>(ApiOptions{.max_pictures = 2}, client_.get());
  }
  // An answer comes before its call has ended.
  void TearDown() override { client_->AwaitCalls(); }

  HttpResponse Get(const std::string& target, const std::string& if_none_match = "",
                   const std::string& token = "") {
    AwaitPlaces();
    HttpRequest request;
    request.target = *ParseTarget(target);
    request.if_none_match = if_none_match;
    request.token = token;
    HttpResponse response;
    absl::Notification answered;
    api_->Answer(std::move(request), std::make_shared<RequestScope>(), [&](HttpResponse answer) {
      response = std::move(answer);
      answered.Notify();
    });
    answered.WaitForNotification();
    return response;
  }

  // An answer comes shortly before its place is free.
  void AwaitPlaces() {
    const base::MonotonicTime limit = base::MonotonicNow() + absl::Seconds(60);
    while (api_->pictures_in_work() > 0 && base::MonotonicNow() < limit) {
      absl::SleepFor(absl::Milliseconds(1));
    }
  }

  Cluster cluster_;
  Datasets datasets_;
  Surfaces surfaces_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<CoordinatorClient> client_;
  std::unique_ptr<Api> api_;
};

TEST_F(ApiTest, TheStatusTellsUsersNothingOfOtherUsersFrames) {
  v1::FrameInWork& frame = *cluster_.status.add_frames();
  frame.set_dataset("head");
  frame.set_client("ipv4:192.0.2.99:4711");
  const HttpResponse response = Get("/v1/status");
  EXPECT_EQ(response.status, 200);
  EXPECT_THAT(response.body, HasSubstr("10.0.0.7"));
  EXPECT_THAT(response.body, Not(HasSubstr("192.0.2.99")));
  EXPECT_THAT(response.body, Not(HasSubstr("frames")));
}

TEST_F(ApiTest, ACachedPictureIsGoodUntilItsRequestItsDataOrTheAgentsPixelsChange) {
  const std::string target = "/v1/datasets/head/render?isovalue=1&width=8&height=8";
  const HttpResponse first = Get(target);
  ASSERT_EQ(first.status, 200) << first.body;
  EXPECT_EQ(first.body, "a picture");
  const std::string etag = HeaderOf(first, "ETag");
  EXPECT_EQ(Get(target, etag).status, 304);
  EXPECT_EQ(surfaces_.picture_count, 1);
  EXPECT_EQ(Get("/v1/datasets/head/render?isovalue=2&width=8&height=8", etag).status, 200);
  // Another driver, or a later version: other pixels of the same request.
  datasets_.picture_revision = "cpu 2";
  const HttpResponse other = Get(target, etag);
  EXPECT_EQ(other.status, 200);
  EXPECT_NE(HeaderOf(other, "ETag"), etag);
  datasets_.picture_revision = "cpu 1";
  EXPECT_EQ(Get(target, etag).status, 304);
  datasets_.dataset_id = "4567";
  EXPECT_EQ(Get(target, etag).status, 200);
}

TEST_F(ApiTest, AnUnknownDatasetIsAnsweredWithThoseThatThereAre) {
  const HttpResponse answer = Get("/v1/datasets/none/render?isovalue=1");
  EXPECT_EQ(answer.status, 404);
  EXPECT_THAT(answer.body, HasSubstr("there is no dataset 'none'; there are: head"));
}

TEST_F(ApiTest, NoSharedCacheKeepsWhatATokenWasShownFor) {
  const std::string target = "/v1/datasets/head/render?isovalue=1&width=8&height=8";
  EXPECT_EQ(HeaderOf(Get(target), "Cache-Control"), "public, no-cache");
  EXPECT_EQ(HeaderOf(Get(target, "", "secret"), "Cache-Control"), "private, no-cache");
  EXPECT_EQ(HeaderOf(Get("/v1/datasets/0123/render?isovalue=1&width=8&height=8"), "Cache-Control"),
            "public, max-age=31536000, immutable");
}

// Steps come, and the dataset keeps its id.
TEST_F(ApiTest, APictureOfAStepIsGoodUntilAnotherStepIsMeant) {
  datasets_.step_count = 3;
  const std::string target = "/v1/datasets/head/render?isovalue=1&width=8&height=8&field=velocity";
  const HttpResponse last = Get(target);
  ASSERT_EQ(last.status, 200) << last.body;
  EXPECT_EQ(HeaderOf(last, "X-Isoscope-Selection"), R"({"field":"velocity","timeStep":2})");
  EXPECT_EQ(HeaderOf(last, "X-Isoscope-Time"), "1.0");
  const std::string etag = HeaderOf(last, "ETag");
  const auto status = [&](const std::string& asked) { return Get(asked, etag).status; };
  EXPECT_EQ(status(absl::StrCat(target, "&step=2")), 304);
  EXPECT_EQ(status(absl::StrCat(target, "&time=0.9")), 304);
  EXPECT_EQ(status(absl::StrCat(target, "&step=1")), 200);
  EXPECT_EQ(status("/v1/datasets/head/render?isovalue=1&width=8&height=8"), 200);
  datasets_.step_count = 4;
  EXPECT_EQ(status(target), 200) << "another step is the last one";
  EXPECT_EQ(status(absl::StrCat(target, "&step=2")), 304);
}

// Two series whose first steps are equal have one dataset id.
TEST_F(ApiTest, APictureOfAStepIsOfItsVolumes) {
  datasets_.step_count = 4;
  const auto etag_of = [&](int step) {
    return HeaderOf(
        Get(absl::StrCat("/v1/datasets/0123/render?isovalue=1&width=8&height=8&step=", step)),
        "ETag");
  };
  const std::string first = etag_of(0);
  const std::string third = etag_of(3);
  EXPECT_NE(first, third);
  datasets_.later_samples = "of another run";
  EXPECT_EQ(etag_of(0), first);
  EXPECT_NE(etag_of(3), third);
}

TEST_F(ApiTest, ColorsWithoutARangeAreGoodUntilTheRangeOfAllStepsChanges) {
  datasets_.step_count = 3;
  const std::string step = "/v1/datasets/head/render?isovalue=1&width=8&height=8&step=0&color-by=";
  const std::string open = HeaderOf(Get(absl::StrCat(step, "velocity")), "ETag");
  const std::string given = HeaderOf(Get(absl::StrCat(step, "velocity:magma:0,1")), "ETag");
  datasets_.step_count = 4;
  EXPECT_EQ(Get(absl::StrCat(step, "velocity"), open).status, 200);
  EXPECT_EQ(Get(absl::StrCat(step, "velocity:magma:0,1"), given).status, 304);
}

TEST_F(ApiTest, OnlyWhatTheDatasetIdNamesIsImmutable) {
  datasets_.step_count = 3;
  const struct {
    const char* parameters;
    const char* cache_control;
  } cases[] = {{"", "public, no-cache"},
               {"&step=last", "public, no-cache"},
               {"&time=0", "public, no-cache"},
               {"&step=0&color-by=velocity", "public, no-cache"},
               {"&step=2", "public, no-cache"},  // the id names the first step alone
               {"&step=3", "no-store"},
               {"&field=hue", "no-store"},
               {"&step=0", "public, max-age=31536000, immutable"},
               {"&step=0&color-by=velocity:magma:0,1", "public, max-age=31536000, immutable"}};
  for (const auto& c : cases) {
    const std::string target =
        absl::StrCat("/v1/datasets/0123/render?isovalue=1&width=8&height=8", c.parameters);
    EXPECT_EQ(HeaderOf(Get(target), "Cache-Control"), c.cache_control) << target;
  }
}

TEST_F(ApiTest, TheDocumentOfTheInterfaceIsPartOfIt) {
  const HttpResponse document = Get("/v1/openapi.json");
  EXPECT_EQ(document.status, 200);
  EXPECT_EQ(document.content_type, "application/json");
  EXPECT_THAT(document.body, HasSubstr("\"/v1/openapi.json\""));
  EXPECT_EQ(Get("/v1/openapi.json?x=1").status, 400);
}

TEST_F(ApiTest, AnUnknownAddressTellsThoseThatThereAre) {
  const HttpResponse answer = Get("/v1/datasets/head/mesh.exe");
  EXPECT_EQ(answer.status, 404);
  EXPECT_THAT(answer.body, HasSubstr("/v1/datasets/{name}/mesh.ply"));
}

TEST_F(ApiTest, APictureIsDrawnOverWhereThatIsAskedFor) {
  surfaces_.png = image::EncodePng(128, 96, std::vector<image::Rgba8>(std::size_t{128} * 96));
  surfaces_.camera.mutable_eye()->set_z(9);
  surfaces_.camera.mutable_target();
  surfaces_.camera.mutable_up()->set_y(1);
  surfaces_.camera.mutable_perspective()->set_fov_y_degrees(30);
  const std::string plain = "/v1/datasets/0123/render?isovalue=1&width=128&height=96";
  const std::string drawn = absl::StrCat(plain, "&axes&caption=a");
  const HttpResponse first = Get(plain);
  const HttpResponse second = Get(drawn);
  ASSERT_EQ(second.status, 200) << second.body;
  EXPECT_EQ(first.body, surfaces_.png);
  EXPECT_NE(second.body, surfaces_.png);
  EXPECT_NE(HeaderOf(second, "ETag"), HeaderOf(first, "ETag"));
  EXPECT_EQ(HeaderOf(second, "Cache-Control"), "public, no-cache") << "by id, too";
  const int count = surfaces_.picture_count;
  EXPECT_EQ(Get(drawn, HeaderOf(second, "ETag")).status, 304);
  EXPECT_EQ(surfaces_.picture_count, count);
  EXPECT_NE(Get(absl::StrCat(plain, "&axes&caption=b")).body, second.body);
}

TEST_F(ApiTest, APictureThatCantBeDrawnOverIsAnError) {
  const HttpResponse answer = Get("/v1/datasets/head/render?isovalue=1&width=8&height=8&axes");
  EXPECT_GE(answer.status, 400) << "the fake's picture is no PNG";
  EXPECT_THAT(answer.body, HasSubstr("\"code\""));
  EXPECT_EQ(Get("/v1/datasets/head/render?isovalue=1&width=8&height=8&axes&format=jpeg").status,
            400);
  EXPECT_EQ(surfaces_.picture_count, 1) << "the second one was not asked for";
}

TEST_F(ApiTest, AWebpIsAnotherAnswerWithTheSamePixels) {
  surfaces_.png = image::EncodePng(8, 8, std::vector<image::Rgba8>(64, image::Rgba8{9, 8, 7, 255}));
  const std::string plain = "/v1/datasets/head/render?isovalue=1&width=8&height=8";
  const HttpResponse png = Get(plain);
  const HttpResponse webp = Get(absl::StrCat(plain, "&format=webp"));
  ASSERT_EQ(webp.status, 200) << webp.body;
  EXPECT_EQ(webp.content_type, "image/webp");
  EXPECT_EQ(webp.body.substr(8, 8), "WEBPVP8L");
  EXPECT_NE(HeaderOf(webp, "ETag"), HeaderOf(png, "ETag"));
  EXPECT_EQ(Get(absl::StrCat(plain, "&format=webp"), HeaderOf(webp, "ETag")).status, 304);
  EXPECT_EQ(Get(absl::StrCat(plain, "&format=webp&record")).status, 400);
}

// Films whose files are in a folder of the test.
class FilmTest : public ApiTest {
 protected:
  FilmTest() {
    setenv("TMPDIR", folder_.path().c_str(), /*replace=*/1);
    surfaces_.png = image::EncodePng(64, 48, std::vector<image::Rgba8>(std::size_t{64} * 48));
    surfaces_.camera.mutable_eye()->set_z(9);
    surfaces_.camera.mutable_target();
    surfaces_.camera.mutable_up()->set_y(1);
    surfaces_.camera.mutable_perspective()->set_fov_y_degrees(30);
  }
  ~FilmTest() override { unsetenv("TMPDIR"); }

  [[nodiscard]] bool HasFiles() const { return !std::filesystem::is_empty(folder_.path()); }

  testing::TempDir folder_;
};

constexpr char kFilm[] = "/v1/datasets/head/film.webp?isovalue=1&width=64&height=48";

TEST_F(FilmTest, AFilmIsOnePictureOfEachFrameInAFile) {
  datasets_.step_count = 4;
  surfaces_.png = image::EncodePng(64, 48, std::vector<image::Rgba8>(std::size_t{64} * 48));
  const HttpResponse film = Get(absl::StrCat(kFilm, "&step=0:last:2&field=velocity"));
  ASSERT_EQ(film.status, 200) << film.body;
  EXPECT_EQ(film.content_type, "image/webp");
  EXPECT_EQ(HeaderOf(film, "Cache-Control"), "no-store");
  ASSERT_EQ(surfaces_.requests.size(), 2U);
  EXPECT_EQ(surfaces_.requests[0].selection().time_step(), 0);
  EXPECT_EQ(surfaces_.requests[1].selection().time_step(), 2);
  EXPECT_GT(std::filesystem::file_size(film.file_path), 20U);
  RemoveTemporaryFile(film.file_path);
  EXPECT_FALSE(HasFiles());
}

// Symptom: a step that was appended meanwhile came into a turn of the last step.
TEST_F(FilmTest, AllFramesAreOfOneDatasetAndOfTheStepThatWasTheLast) {
  datasets_.step_count = 3;
  const HttpResponse film = Get(absl::StrCat(kFilm, "&repeat=2&orbit=9&field=velocity"));
  ASSERT_EQ(film.status, 200) << film.body;
  RemoveTemporaryFile(film.file_path);
  ASSERT_EQ(surfaces_.requests.size(), 2U);
  for (const v1::RenderIsosurfaceRequest& request : surfaces_.requests) {
    EXPECT_EQ(request.dataset_id(), "0123");
    EXPECT_EQ(request.selection().time_step(), 2);
    EXPECT_TRUE(request.selection().has_time_step());
  }
}

TEST_F(FilmTest, AClientThatLeavesEndsTheFrameInWorkAndTheFile) {
  surfaces_.endless_picture = 2;
  HttpRequest request;
  request.target = *ParseTarget(absl::StrCat(kFilm, "&repeat=3"));
  const auto scope = std::make_shared<RequestScope>();
  HttpResponse response;
  absl::Notification answered;
  api_->Answer(std::move(request), scope, [&](HttpResponse answer) {
    response = std::move(answer);
    answered.Notify();
  });
  surfaces_.is_endless.WaitForNotification();
  EXPECT_TRUE(HasFiles());
  scope->Cancel();
  answered.WaitForNotification();
  EXPECT_EQ(response.status, 499);
  EXPECT_FALSE(HasFiles());
  AwaitPlaces();
  EXPECT_EQ(surfaces_.picture_count, 2);
}

// An agent that restarts, or a full queue: the frames before are not lost.
TEST_F(FilmTest, AFrameThatIsRefusedForAWhileIsAskedForAgain) {
  surfaces_.refused_picture = 2;
  surfaces_.refusal_count = 2;
  surfaces_.refusal =
      base::WithRetryDelay(absl::UnavailableError("the agent is opening"), absl::Milliseconds(20));
  const base::MonotonicTime start = base::MonotonicNow();
  const HttpResponse film = Get(absl::StrCat(kFilm, "&repeat=3&orbit=9"));
  ASSERT_EQ(film.status, 200) << film.body;
  EXPECT_GE(base::MonotonicNow() - start, absl::Milliseconds(40)) << "both delays";
  RemoveTemporaryFile(film.file_path);
  ASSERT_EQ(surfaces_.requests.size(), 5U);
  const auto bytes = [&](std::size_t i) { return surfaces_.requests[i].SerializeAsString(); };
  EXPECT_EQ(bytes(1), bytes(2));
  EXPECT_EQ(bytes(1), bytes(3));
  EXPECT_NE(bytes(3), bytes(4));
  EXPECT_NE(bytes(0), bytes(1));
}

TEST_F(FilmTest, OtherErrorsOfAFrameAndDelaysBeyondItsDeadlineEndTheFilm) {
  for (const absl::Status& refusal :
       {absl::UnavailableError("the agent is lost"),
        base::WithRetryDelay(absl::UnavailableError("much later"), absl::Hours(1))}) {
    surfaces_.picture_count = 0;
    surfaces_.refused_picture = 2;
    surfaces_.refusal_count = 1;
    surfaces_.refusal = refusal;
    const HttpResponse film = Get(absl::StrCat(kFilm, "&repeat=3&orbit=9"));
    EXPECT_EQ(film.status, 503);
    EXPECT_THAT(film.body, HasSubstr(std::string(refusal.message())));
    EXPECT_EQ(surfaces_.picture_count, 2);
    EXPECT_FALSE(HasFiles());
  }
}

TEST_F(FilmTest, AClientThatLeavesEndsTheWaitForAFrameAndTheFile) {
  surfaces_.refusal_count = 1;
  surfaces_.refusal =
      base::WithRetryDelay(absl::ResourceExhaustedError("the queue is full"), absl::Minutes(4));
  HttpRequest request;
  request.target = *ParseTarget(absl::StrCat(kFilm, "&repeat=3"));
  const auto scope = std::make_shared<RequestScope>();
  HttpResponse response;
  absl::Notification answered;
  api_->Answer(std::move(request), scope, [&](HttpResponse answer) {
    response = std::move(answer);
    answered.Notify();
  });
  surfaces_.was_refused.WaitForNotification();
  EXPECT_FALSE(answered.WaitForNotificationWithTimeout(absl::Milliseconds(200)));
  scope->Cancel();
  answered.WaitForNotification();
  EXPECT_EQ(response.status, 499);
  AwaitPlaces();
  EXPECT_EQ(surfaces_.picture_count, 1);
  EXPECT_FALSE(HasFiles());
}

TEST_F(FilmTest, HeadOfAFilmEndsWithItsFirstFrame) {
  HttpRequest request;
  request.target = *ParseTarget(absl::StrCat(kFilm, "&repeat=3"));
  request.is_head = true;
  HttpResponse response;
  absl::Notification answered;
  api_->Answer(std::move(request), std::make_shared<RequestScope>(), [&](HttpResponse answer) {
    response = std::move(answer);
    answered.Notify();
  });
  answered.WaitForNotification();
  EXPECT_EQ(response.status, 200);
  EXPECT_EQ(response.content_type, "image/webp");
  EXPECT_TRUE(response.has_unknown_length);
  EXPECT_EQ(surfaces_.picture_count, 1);
  EXPECT_FALSE(HasFiles());
}

TEST_F(FilmTest, AFilmThatCantBeIsRefusedBeforeItsFirstFrame) {
  EXPECT_THAT(Get(absl::StrCat(kFilm, "&repeat=721")).body, HasSubstr("limit is 720"));
  EXPECT_THAT(Get(absl::StrCat(kFilm, "&legend")).body, HasSubstr("color-by"));
  EXPECT_EQ(Get(absl::StrCat(kFilm, "&orbit=3")).status, 400);
  EXPECT_EQ(surfaces_.picture_count, 0);
  surfaces_.png = "no PNG";
  EXPECT_GE(Get(absl::StrCat(kFilm, "&repeat=2")).status, 400);
  EXPECT_EQ(surfaces_.picture_count, 1);
  EXPECT_FALSE(HasFiles());
}

TEST_F(ApiTest, HistogramsAreOfAFieldAndAStep) {
  datasets_.step_count = 3;
  EXPECT_EQ(Get("/v1/datasets/head/histogram?bins=8&field=velocity:x&step=1").body,
            R"({"selection":{"field":"velocity:x","timeStep":1}})");
  EXPECT_EQ(Get("/v1/datasets/head/histogram").body, "{}");
  EXPECT_EQ(Get("/v1/datasets/head/histogram?step=x").status, 400);
  EXPECT_EQ(Get("/v1/datasets/head/histogram?isovalue=1").status, 400);
}

TEST_F(ApiTest, PlacesForPicturesComeBackHoweverTheyEnd) {
  for (const char* const target :
       {"/v1/datasets/head/render?isovalue=1&width=8&height=8",
        "/v1/datasets/none/render?isovalue=1", "/v1/datasets/head/render?isovalue=x",
        "/v1/datasets/head/render?isovalue=1&width=8&height=8&axes",
        "/v1/datasets/head/mesh.stl?isovalue=1&color=teal",
        "/v1/datasets/head/film.apng?isovalue=1&width=8&height=8&repeat=2",
        "/v1/datasets/head/film.apng?isovalue=1&orbit=2"}) {
    EXPECT_NE(Get(target).status, 429);
    AwaitPlaces();
    ASSERT_EQ(api_->pictures_in_work(), 0) << target;
  }
}

}  // namespace
}  // namespace isoscope::gateway
