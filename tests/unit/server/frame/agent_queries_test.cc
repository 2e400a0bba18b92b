// Histograms and fitted cameras of the public services, against agents of a script.

#include "server/frame/agent_queries.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/view/camera_fit.h"
#include "core/visibility/depth_bounds.h"
#include "server/cluster/replica_board.h"
#include "tests/support/enough_time.h"
#include "tests/unit/server/fake_cluster.h"
#include "wire/depth_bounds_convert.h"
#include "wire/first_look.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

using ::testing::AllOf;
using testing::FakeAgent;
using testing::HangUntilCancelled;
using ::testing::HasSubstr;
using testing::kLimit;
using testing::MakeShard;
using testing::StatusIs;

// After it, a question is also put to another agent (agent_queries.cc).
constexpr absl::Duration kHedgeDelay = absl::Milliseconds(500);

// Two bins, of values 10 and 11, with these counts.
void FillPart(std::int64_t lower, std::int64_t upper,
              internal::GetShardHistogramResponse* response) {
  response->set_first_bin(10);
  response->set_stored_bin_count(2);
  response->set_bins_per_group_count(1);
  for (const std::int64_t count : {lower, upper}) {
    response->add_active_block_counts(count);
    response->add_active_block_bytes(100 * count);
    response->add_estimated_triangle_counts(179 * count);
    response->mutable_samples()->add_counts(1000 * count);
  }
  response->mutable_samples()->set_nan_count(lower);
}

// An agent whose part has these counts, once `change` has changed it.
template <typename Change>
auto AnswerWith(std::int64_t lower, std::int64_t upper, const Change& change) {
  return [=](grpc::ServerContext*, const auto& request, auto* response) {
    FillPart(lower, upper, response);
    change(request, response);
    return grpc::Status::OK;
  };
}
auto AnswerWith(std::int64_t lower, std::int64_t upper) {
  return AnswerWith(lower, upper, [](const auto&, auto*) {});
}

v1::RenderIsosurfaceRequest RequestThatFits() {
  v1::RenderIsosurfaceRequest request = testing::FrameRequest(8, 8);
  request.set_culling(v1::CULLING_NONE);
  request.set_camera_fit(v1::CAMERA_FIT_SURFACE);
  return request;
}

class AgentQueriesTest : public testing::TwoAgentsTest {
 protected:
  // A question for the box of a surface.
  struct AskedBox {
    const FakeAgent* agent = nullptr;
    internal::GetActiveBoxRequest request;
  };

  AgentQueriesTest() {
    first_.on_histogram = AnswerWith(1, 2);
    second_.on_histogram = AnswerWith(3, 4);
    for (FakeAgent* agent : {&first_, &second_}) {
      agent->on_frame = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
        internal::RenderFrameRequest request;
        stream->Read(&request);
        {
          const base::MutexLock lock(&mutex_);
          begin_ = request.begin();
        }
        internal::RenderFrameResponse response;
        response.mutable_frame_done();
        stream->Write(response);
        return grpc::Status::OK;
      };
      agent->on_active_box = [this, agent](const internal::GetActiveBoxRequest& request,
                                           auto* response) {
        {
          const base::MutexLock lock(&mutex_);
          asked_.push_back({agent, request});
        }
        if (agent == without_disk_) {
          return grpc::Status(grpc::StatusCode::DATA_LOSS, "the disk smokes");
        }
        *response = answer_;
        return grpc::Status::OK;
      };
    }
  }

  absl::StatusOr<v1::GetHistogramResponse> Ask(absl::Duration timeout = kLimit,
                                               const v1::GetHistogramRequest& request = {}) {
    return Call(datasets_, &v1::DatasetService::Stub::GetHistogram, request, "", timeout);
  }
  absl::StatusOr<v1::Camera> RenderedCamera(const v1::RenderIsosurfaceRequest& request,
                                            absl::Duration timeout = kLimit) {
    ISOSCOPE_ASSIGN_OR_RETURN(const auto response, Render(request, timeout));
    return response.camera();
  }

  // Renders other isovalues until it takes less than kHedgeDelay: then no question was put twice. A
  // late call of a try before has that one's isovalue.
  absl::StatusOr<v1::RenderIsosurfaceResponse> RenderInTime(v1::RenderIsosurfaceRequest* request) {
    constexpr int kMostTries = 100;
    for (int i = 0; i < kMostTries; ++i) {
      request->set_isovalue(request->isovalue() + 1);
      const base::MonotonicTime begin = base::MonotonicNow();
      absl::StatusOr<v1::RenderIsosurfaceResponse> response = Render(*request);
      if (base::MonotonicNow() - begin < kHedgeDelay) {
        return response;
      }
    }
    return absl::DeadlineExceededError("every try took too long");
  }
  // The questions for the box of this surface.
  std::vector<AskedBox> AskedFor(double isovalue) ABSL_LOCKS_EXCLUDED(mutex_) {
    std::vector<AskedBox> found;
    const base::MutexLock lock(&mutex_);
    for (const AskedBox& asked : asked_) {
      if (asked.request.isovalues_size() == 1 && asked.request.isovalues(0) == isovalue) {
        found.push_back(asked);
      }
    }
    return found;
  }
  internal::BeginFrame LastBegin() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return begin_;
  }

  internal::GetActiveBoxResponse answer_;  // set before the start
  std::atomic<const FakeAgent*> without_disk_{nullptr};
  base::Mutex
      mutex_;  // agents are asked at a time, and a late one may still play what it was asked
  std::vector<AskedBox> asked_ ABSL_GUARDED_BY(mutex_);
  internal::BeginFrame begin_ ABSL_GUARDED_BY(mutex_);
};

TEST_F(AgentQueriesTest, PartsOfAllAgentsAddUpAndEachIsAskedForItsOwnShards) {
  std::string shards;
  second_.on_histogram =
      AnswerWith(3, 4, [&](const auto& request, auto*) { shards = request.ShortDebugString(); });
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::GetHistogramResponse response, Ask());
  EXPECT_THAT(shards, AllOf(HasSubstr("shard_indices: 1"), HasSubstr("max_bin_count: 256")));
  ASSERT_EQ(response.bins_size(), 2);
  EXPECT_EQ(response.bins(0).sample_count(), 4000);
  EXPECT_EQ(response.bins(1).sample_count(), 6000);
  EXPECT_EQ(response.bins(1).active_block_count(), 6);
  EXPECT_EQ(response.bins(1).active_block_bytes(), 600);
  EXPECT_EQ(response.bins(1).estimated_triangle_count(), 179 * 6);
  EXPECT_EQ(response.nan_count(), 4);
  ASSERT_EQ(response.suggestions_size(), 2);
  EXPECT_EQ(response.suggestions(0).isovalue(), 10.5);
  EXPECT_DOUBLE_EQ(response.suggestions(0).inside_fraction(), 0.6);
}

TEST_F(AgentQueriesTest, AnAgentWithoutCountsLeavesTheVolumeWithout) {
  second_.on_histogram =
      AnswerWith(3, 4, [](const auto&, auto* response) { response->clear_samples(); });
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::GetHistogramResponse response, Ask());
  EXPECT_FALSE(response.has_sample_counts());
  EXPECT_EQ(response.bins(0).sample_count(), 0);
  EXPECT_EQ(response.bins(0).active_block_count(), 4);
  EXPECT_TRUE(response.suggestions().empty());
}

// Symptom: a lost agent failed the partial picture, because its caps asked for percentiles.
TEST_F(AgentQueriesTest, APartialPictureWithoutAllCountsHasTheRangeOfItsStep) {
  std::atomic<int> asked{0};
  second_.on_histogram = [&asked](grpc::ServerContext*, const auto&, auto*) {
    ++asked;
    return grpc::Status(grpc::StatusCode::UNAVAILABLE, "gone");
  };
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = testing::FrameRequest(8, 8);
  request.set_culling(v1::CULLING_NONE);
  request.set_allow_partial(true);
  request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  request.mutable_caps()->set_color_map(v1::COLOR_MAP_GREY);
  request.mutable_caps()->mutable_range()->mutable_percentiles()->set_high(98);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
  EXPECT_GE(asked.load(), 1);
  EXPECT_EQ(response.caps_coloring().caps().range().min(), 0);
  EXPECT_EQ(response.caps_coloring().caps().range().max(), 255);
}

TEST_F(AgentQueriesTest, AFailureNamesAgentAndShards) {
  struct Row {
    grpc::StatusCode sent;
    absl::StatusCode seen;
  };
  for (const Row& row : {Row{grpc::StatusCode::DATA_LOSS, absl::StatusCode::kDataLoss},
                         Row{grpc::StatusCode::UNAVAILABLE, absl::StatusCode::kUnavailable},
                         Row{grpc::StatusCode::CANCELLED, absl::StatusCode::kUnavailable}}) {
    second_.Stop();
    first_.Stop();
    second_.on_histogram = [&row](grpc::ServerContext*, const auto&, auto*) {
      return grpc::Status(row.sent, "the disk smokes");
    };
    const Running running = Start();
    EXPECT_THAT(Ask(), StatusIs(row.seen, AllOf(HasSubstr(second_.address()), HasSubstr("shard 1"),
                                                HasSubstr("the disk smokes"))));
  }
}

// Both agents have the whole dataset; the agent that is asked first fails.
class ReplicaQueriesTest : public AgentQueriesTest {
 protected:
  ReplicaQueriesTest() {
    for (FakeAgent* agent : {&first_, &second_}) {
      agent->SetShards({MakeShard("head", 0, 1)});
      agent->on_histogram = [this](grpc::ServerContext*, const auto&, auto* response) {
        if (++asked_count_ <= failing_count_) {
          return grpc::Status(grpc::StatusCode::DATA_LOSS, "the disk smokes");
        }
        FillPart(1, 2, response);
        return grpc::Status::OK;
      };
    }
  }

  std::atomic<int> asked_count_{0};
  int failing_count_ = 1;
};

TEST_F(ReplicaQueriesTest, AnotherAgentAnswersWhereOneFails) {
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::GetHistogramResponse response, Ask());
  EXPECT_EQ(asked_count_, 2);
  ASSERT_EQ(response.bins_size(), 2);
  EXPECT_EQ(response.bins(0).sample_count(), 1000);
}

TEST_F(ReplicaQueriesTest, WhereAllFailTheErrorIsTheLastOnes) {
  failing_count_ = 2;
  const Running running = Start();
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("the disk smokes")));
  EXPECT_EQ(asked_count_, 2);
}

TEST_F(ReplicaQueriesTest, AnotherAgentAnswersWhileOneHangs) {
  std::atomic<int> cancelled_count{0};
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->on_histogram = [&](grpc::ServerContext* context, const auto&, auto* response) {
      if (++asked_count_ == 1) {
        return HangUntilCancelled(context, &cancelled_count);
      }
      FillPart(1, 2, response);
      return grpc::Status::OK;
    };
  }
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::GetHistogramResponse response, Ask());
  EXPECT_EQ(asked_count_, 2);
  EXPECT_EQ(response.bins(0).sample_count(), 1000);
  coordinator_.reset();
  first_.Stop();
  second_.Stop();
  EXPECT_EQ(cancelled_count, 1) << "the one that hangs is let go";
}

TEST_F(ReplicaQueriesTest, WhereAllHangTheErrorIsTheDeadlines) {
  // By bins, which tell attempts apart: an agent may begin with a call whose client has gone.
  base::Mutex mutex;
  std::map<int, int> counts;
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->on_histogram = [&](grpc::ServerContext* context,
                              const internal::GetShardHistogramRequest& request, auto*) {
      {
        const base::MutexLock lock(&mutex);
        ++counts[request.max_bin_count()];
      }
      return HangUntilCancelled(context);
    };
  }
  const Running running = Start();
  v1::GetHistogramRequest request;
  request.set_max_bin_count(100);
  testing::WithEnoughTime(absl::Milliseconds(800), [&](absl::Duration time) {
    request.set_max_bin_count(request.max_bin_count() + 1);
    EXPECT_THAT(Ask(time, request), StatusIs(absl::StatusCode::kDeadlineExceeded));
    const base::MutexLock lock(&mutex);
    const int count = counts[request.max_bin_count()];
    EXPECT_LE(count, 2);
    return count == 2;
  });
}

// The frames of one client, whose time is short, are done by the replica. Others still come to the
// agent that has their blocks.
TEST_F(ReplicaQueriesTest, AClientInAHurryDoesNotSpoilAnAgentForOthers) {
  std::atomic<FakeAgent*> slow{nullptr};
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->on_frame = [&, agent](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
      return agent == slow ? HangUntilCancelled(context) : testing::PlayEmptyFrame(stream);
    };
  }
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = RequestThatFits();
  request.clear_camera_fit();
  // The agent that did it.
  const auto agent_of = [](const v1::RenderIsosurfaceResponse& response) {
    EXPECT_EQ(response.statistics().agents_size(), 1);
    return response.statistics().agents(0).agent_address();
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse before, Render(request));
  const std::string best = agent_of(before);
  slow = best == first_.address() ? &first_ : &second_;
  // A replica under load may need longer. More time would be no hurry.
  constexpr int kMostAttempts = 50;
  int done_count = 0;
  absl::Duration longest;
  for (int attempt = 0; done_count < 3 && attempt < kMostAttempts; ++attempt) {
    const base::MonotonicTime begin = base::MonotonicNow();
    const auto response = Render(request, absl::Milliseconds(400));
    if (response.ok()) {
      ++done_count;
      EXPECT_NE(agent_of(*response), best) << "the replica did it";
    } else {
      EXPECT_THAT(response, StatusIs(absl::StatusCode::kDeadlineExceeded));
    }
    longest = std::max(longest, base::MonotonicNow() - begin);
  }
  EXPECT_EQ(done_count, 3);
  slow = nullptr;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse after, Render(request));
  // An agent that was waited for as long as kLateAfter, while the machine stood still, is avoided.
  if (longest < ReplicaBoard::kLateAfter) {
    EXPECT_EQ(agent_of(after), best) << "it was avoided";
  }
}

// All agents know all ranges.
TEST_F(AgentQueriesTest, BoxesAreAskedOfAllAgentsInTurnAndOfAnotherOneIfOneFails) {
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = RequestThatFits();
  constexpr int kMostFrames = 200;
  int in_time_count = 0;
  const FakeAgent* of_even_turns = nullptr;
  for (int turn = 0; in_time_count < 6 && turn < kMostFrames; ++turn) {
    request.set_isovalue(request.isovalue() + 1);
    const base::MonotonicTime begin = base::MonotonicNow();
    ISOSCOPE_ASSERT_OK(Render(request));
    if (base::MonotonicNow() - begin >= kHedgeDelay) {  // then the other agent is asked, too
      continue;
    }
    ++in_time_count;
    const std::vector<AskedBox> asked = AskedFor(request.isovalue());
    ASSERT_EQ(asked.size(), 1U);
    const FakeAgent* const other = asked[0].agent == &first_ ? &second_ : &first_;
    const FakeAgent* const of_even = turn % 2 == 0 ? asked[0].agent : other;
    EXPECT_TRUE(of_even_turns == nullptr || of_even == of_even_turns) << "frame " << turn;
    of_even_turns = of_even;
  }
  EXPECT_EQ(in_time_count, 6);
  without_disk_ = &first_;
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_EXPECT_OK(Render(request));
  }
}

TEST_F(AgentQueriesTest, AnAgentThatHangsIsNamedAtTheDeadlineAndACallerThatLeavesIsLetGo) {
  second_.on_histogram = [](grpc::ServerContext* context, const auto&, auto*) {
    return HangUntilCancelled(context);
  };
  const Running running = Start();
  EXPECT_THAT(Ask(absl::Milliseconds(300)), StatusIs(absl::StatusCode::kDeadlineExceeded));
}

TEST_F(AgentQueriesTest, AnswersThatCanNotBeRightAreInternalErrors) {
  second_.on_histogram = AnswerWith(
      3, 4, [](const auto&, auto* response) { response->set_active_block_counts(0, -1); });
  const Running running = Start();
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kInternal,
                              AllOf(HasSubstr(second_.address()), HasSubstr("malformed"))));
  second_.on_histogram =
      AnswerWith(3, 4, [](const auto&, auto* response) { response->set_first_bin(11); });
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kInternal, HasSubstr("different datasets")));
}

// The dataset of MakeShard has 9^3 samples of unit spacing at the origin.
math::Box3d BoxOf(double min, double max) {
  math::Box3d box;
  box.Add({min, min, min});
  box.Add({max, max, max});
  return box;
}

TEST_F(AgentQueriesTest, ACameraIsFittedOnceAndAgentsGetTheFinalOne) {
  answer_.set_active_block_count(1);
  for (auto* corner : {answer_.mutable_begin_cell(), answer_.mutable_end_cell()}) {
    const int at = corner == answer_.mutable_end_cell() ? 8 : 4;
    corner->set_x(at);
    corner->set_y(at);
    corner->set_z(at);
  }
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = RequestThatFits();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse first, RenderInTime(&request));
  EXPECT_EQ(AskedFor(request.isovalue()).size(), 1U) << "one agent knows all ranges";
  const v1::Camera& by_default = first.camera();
  EXPECT_EQ(by_default.SerializeAsString(),
            wire::ToProto(view::MakeDefaultCamera(BoxOf(4, 8))).SerializeAsString());
  EXPECT_EQ(LastBegin().frame().camera().SerializeAsString(), by_default.SerializeAsString());

  view::Camera given = view::MakeDefaultCamera(BoxOf(0, 8));
  view::Azimuth(0.5, &given);
  view::Zoom(2, &given);
  *request.mutable_camera() = wire::ToProto(given);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse second, RenderInTime(&request));
  const v1::Camera& moved = second.camera();
  const view::Camera expected = view::MoveToBox(
      wire::CameraFromProto(request.camera(), "camera").value(), BoxOf(0, 8), BoxOf(4, 8));
  EXPECT_EQ(moved.SerializeAsString(), wire::ToProto(expected).SerializeAsString());

  // The answer makes the picture again.
  request.set_camera_fit(v1::CAMERA_FIT_VOLUME);
  *request.mutable_camera() = moved;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera again, RenderedCamera(request));
  EXPECT_EQ(again.SerializeAsString(), moved.SerializeAsString());
  EXPECT_EQ(AskedFor(request.isovalue()).size(), 1U) << "not asked for this one";
}

// Sets a box of cells, the same on all axes.
void SetCells(int begin, int end, internal::GetCellBoxResponse* response) {
  for (auto* corner : {response->mutable_begin_cell(), response->mutable_end_cell()}) {
    const int at = corner == response->mutable_end_cell() ? end : begin;
    corner->set_x(at);
    corner->set_y(at);
    corner->set_z(at);
  }
}

class CellBoxQueriesTest : public AgentQueriesTest {
 protected:
  CellBoxQueriesTest() {
    for (const int i : {0, 1}) {
      (i == 0 ? first_ : second_).on_cell_box = [this, i](const auto& request, auto* response) {
        ++counts_[i];
        asked_of_[i] = request;
        *response = cells_[i];
        return grpc::Status::OK;
      };
    }
  }
  static v1::RenderIsosurfaceRequest Request() {
    v1::RenderIsosurfaceRequest request = RequestThatFits();
    request.set_camera_fit(v1::CAMERA_FIT_CELLS);
    return request;
  }
  // The first look at a box, of a picture of 8 x 8.
  static std::string FirstLookAt(const math::Box3d& box) {
    return wire::ToProto(view::FitToBox(wire::FirstLookCamera(BoxOf(0, 8), std::nullopt), {8, 8},
                                        BoxOf(0, 8), box))
        .SerializeAsString();
  }

  std::atomic<int> counts_[2] = {0, 0};
  internal::GetCellBoxRequest asked_of_[2];
  internal::GetCellBoxResponse cells_[2];
};

TEST_F(CellBoxQueriesTest, TheBoxIsThatOfAllAgentsAndAskedOnce) {
  SetCells(2, 4, &cells_[0]);
  SetCells(3, 7, &cells_[1]);
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera camera, RenderedCamera(request));
  EXPECT_EQ(camera.SerializeAsString(), FirstLookAt(BoxOf(2, 7)));
  for (const int i : {0, 1}) {
    ASSERT_EQ(asked_of_[i].shard_indices_size(), 1);
    EXPECT_EQ(asked_of_[i].isovalues(0), 100);
  }
  EXPECT_NE(asked_of_[0].shard_indices(0), asked_of_[1].shard_indices(0));
  // The coordinator knows it now, for any camera.
  *request.mutable_camera() = wire::ToProto(view::MakeDefaultCamera(BoxOf(0, 8)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera front, RenderedCamera(request));
  EXPECT_EQ(front.SerializeAsString(),
            wire::ToProto(view::FitToBox(wire::CameraFromProto(request.camera(), "camera").value(),
                                         {8, 8}, BoxOf(0, 8), BoxOf(2, 7)))
                .SerializeAsString());
  EXPECT_EQ(counts_[0], 1);
  EXPECT_EQ(counts_[1], 1);
  request.set_isovalue(101);
  ISOSCOPE_EXPECT_OK(RenderedCamera(request));
  request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  ISOSCOPE_EXPECT_OK(RenderedCamera(request));
  EXPECT_EQ(counts_[0], 3) << "other surfaces and other regions have other cells";

  // The answer makes the picture again.
  request = Request();
  *request.mutable_camera() = camera;
  request.set_camera_fit(v1::CAMERA_FIT_VOLUME);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera again, RenderedCamera(request));
  EXPECT_EQ(again.SerializeAsString(), camera.SerializeAsString());
}

TEST_F(CellBoxQueriesTest, WithoutCellsTheVolumeIsFramedAndThatIsKnownToo) {
  const Running running = Start();
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera camera, RenderedCamera(Request()));
    EXPECT_EQ(camera.SerializeAsString(), FirstLookAt(BoxOf(0, 8)));
  }
  EXPECT_EQ(counts_[0] + counts_[1], 2);
}

TEST_F(CellBoxQueriesTest, ABoxOutsideOfTheVolumeIsAnInternalError) {
  SetCells(3, 9, &cells_[1]);
  const Running running = Start();
  EXPECT_THAT(RenderedCamera(Request()),
              StatusIs(absl::StatusCode::kInternal,
                       AllOf(HasSubstr(second_.address()), HasSubstr("malformed"))));
}

class DepthBoundsQueriesTest : public AgentQueriesTest {
 protected:
  DepthBoundsQueriesTest() {
    for (const int i : {0, 1}) {
      (i == 0 ? first_ : second_).on_depth_bounds =
          [this, i](const internal::GetDepthBoundsRequest& asked, auto* response) {
            {
              const base::MutexLock lock(&mutex_);
              asked_bounds_.push_back(asked);
            }
            if (fails_[i]) {
              return grpc::Status(grpc::StatusCode::DATA_LOSS, "the disk smokes");
            }
            visibility::DepthBounds bounds(8, asked.frame().region().height_px());
            // Part 0 has the first column, nearer than part 1, which has two.
            const bool is_first = asked.part_index() == 0;
            bounds.AddToRows({0, 0, is_first ? 1 : 2, 8}, is_first ? 0.25F : 0.5F, 0.75F, 0,
                             bounds.height_px());
            *response = wire::ToProto(bounds);
            change_(response);
            return grpc::Status::OK;
          };
    }
  }
  static v1::RenderIsosurfaceRequest Request() {
    v1::RenderIsosurfaceRequest request = testing::FrameRequest(8, 8);
    request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
    request.mutable_output()->set_depth_bounds(true);
    return request;
  }

  // The questions for the bounds of this surface.
  std::vector<internal::GetDepthBoundsRequest> BoundsAskedFor(double isovalue)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    std::vector<internal::GetDepthBoundsRequest> found;
    const base::MutexLock lock(&mutex_);
    for (const internal::GetDepthBoundsRequest& asked : asked_bounds_) {
      if (asked.frame().surfaces_size() == 1 && asked.frame().surfaces(0).isovalue() == isovalue) {
        found.push_back(asked);
      }
    }
    return found;
  }

  std::vector<internal::GetDepthBoundsRequest> asked_bounds_ ABSL_GUARDED_BY(mutex_);
  std::atomic<bool> fails_[2] = {false, false};
  std::function<void(internal::GetDepthBoundsResponse*)> change_ = [](auto*) {};
};

TEST_F(DepthBoundsQueriesTest, ThePlaneIsTheLeastAndTheGreatestOfAllPartsAndNothingIsDrawn) {
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream*) {
      ADD_FAILURE() << "nothing needs to be drawn";
      return grpc::Status::CANCELLED;
    };
  }
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = Request();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                RenderInTime(&request));
  const std::vector<internal::GetDepthBoundsRequest> all_asked = BoundsAskedFor(request.isovalue());
  ASSERT_EQ(all_asked.size(), 2U);
  for (const internal::GetDepthBoundsRequest& asked : all_asked) {
    EXPECT_EQ(asked.part_count(), 2);
    EXPECT_TRUE(asked.frame().has_camera());
  }
  EXPECT_NE(all_asked[0].part_index(), all_asked[1].part_index());
  const std::string& plane = response.depth_bounds();
  ASSERT_EQ(plane.size(), std::size_t{8} * 8 * 8);
  const auto at = [&](std::size_t pixel, std::size_t channel) {
    return base::LoadLittleEndian<float>(plane.data() + 4 * (2 * pixel + channel));
  };
  for (std::size_t pixel = 0; pixel < 64; ++pixel) {
    if (pixel % 8 >= 2) {
      EXPECT_EQ(at(pixel, 0), INFINITY);
      EXPECT_EQ(at(pixel, 1), INFINITY);
    } else {
      EXPECT_EQ(at(pixel, 1), at(0, 1));
      EXPECT_LT(at(pixel, 0), at(pixel, 1));
    }
  }
  EXPECT_LT(at(0, 0), at(1, 0)) << "a quarter against a half";
}

// All agents know all ranges: one that fails is replaced by one of another part.
TEST_F(DepthBoundsQueriesTest, AnotherAgentAnswersForOneThatFails) {
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse expected, Render(Request()));
  fails_[1] = true;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(Request()));
  EXPECT_TRUE(response.depth_bounds() == expected.depth_bounds());
}

TEST_F(DepthBoundsQueriesTest, AnAnswerThatCanNotBeRightIsAnInternalError) {
  change_ = [](internal::GetDepthBoundsResponse* response) { response->clear_farthest(); };
  const Running running = Start();
  EXPECT_THAT(Render(Request()), StatusIs(absl::StatusCode::kInternal, HasSubstr("malformed")));
}

// Asks two agents directly: frames of level 0 never do.
class UnresolvedQueriesTest : public AgentQueriesTest {
 protected:
  UnresolvedQueriesTest() {
    for (const int i : {0, 1}) {
      (i == 0 ? first_ : second_).on_resolved_blocks =
          [this, i](const internal::GetResolvedBlocksRequest& request, auto* response) {
            asked_of_[i] = request;
            *response->mutable_blocks() = wire::ToProto(resolved_[i]);
            response->set_active_block_count(active_counts_[i]);
            return grpc::Status::OK;
          };
    }
  }
  absl::StatusOr<std::int64_t> Ask() {
    std::vector<FramePart> parts;
    for (const FakeAgent* agent : {&first_, &second_}) {
      parts.push_back({.shard_indices = {static_cast<int>(parts.size())},
                       .replicas = {{.address = agent->address(),
                                     .channel = rpc::MakeFreshChannel(agent->address())}}});
    }
    const std::string id = "some";
    base::Cancellation cancellation(base::MonotonicNow() + kLimit);
    return AskUnresolved({id, parts}, /*block_count=*/100, /*level=*/2,
                         volume::InsideRule::OfIsovalue(7), base::TraceContext::Random(),
                         cancellation)
        .result;
  }

  internal::GetResolvedBlocksRequest asked_of_[2];
  std::vector<volume::BlockId> resolved_[2] = {{1, 5, 9}, {5, 70}};
  std::int64_t active_counts_[2] = {10, 10};
};

TEST_F(UnresolvedQueriesTest, BlocksThatAnyAgentResolvesAreResolvedOnce) {
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t count, Ask());
  EXPECT_EQ(count, 10 - 4);
  for (const int i : {0, 1}) {
    EXPECT_EQ(asked_of_[i].level(), 2);
    EXPECT_EQ(asked_of_[i].isovalue(), 7);
    ASSERT_EQ(asked_of_[i].shard_indices_size(), 1);
    EXPECT_EQ(asked_of_[i].shard_indices(0), i);
  }
}

TEST_F(UnresolvedQueriesTest, AnswersThatCanNotBeRightAreInternalErrors) {
  const Running running = Start();
  active_counts_[1] = 11;
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kInternal, HasSubstr("the same in all answers")));
  active_counts_[1] = active_counts_[0] = 3;
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kInternal, HasSubstr("at least 4")));
  active_counts_[1] = active_counts_[0] = 101;
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kInternal, HasSubstr("100 blocks")));
  active_counts_[1] = active_counts_[0] = 10;
  resolved_[1].push_back(100);
  EXPECT_THAT(Ask(), StatusIs(absl::StatusCode::kInternal, HasSubstr("blocks")));
}

// Two agents whose shards have level 1, and frames without a pixel.
class UnresolvedFramesTest : public testing::FakeClusterTest {
 protected:
  UnresolvedFramesTest() {
    for (const int i : {0, 1}) {
      internal::ShardDescription shard = MakeShard("head", i, 2);
      shard.mutable_levels()->add_levels(1);
      shard.mutable_levels()->set_filter(v1::DatasetLevel::FILTER_MEAN);
      FakeAgent& agent = *AddAgent({shard});
      agent.on_histogram = AnswerWith(1, 2);
      agent.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
        return testing::PlayEmptyFrame(stream);
      };
      agent.on_resolved_blocks = [this, i](const internal::GetResolvedBlocksRequest& request,
                                           auto* response) {
        ++asked_count_;
        EXPECT_EQ(request.level(), 1);
        if (fails_) {
          return grpc::Status(grpc::StatusCode::DATA_LOSS, "the disk smokes");
        }
        *response->mutable_blocks() =
            wire::ToProto(std::vector<volume::BlockId>{static_cast<volume::BlockId>(i), 2});
        response->set_active_block_count(7);
        return grpc::Status::OK;
      };
    }
  }
  absl::StatusOr<v1::RenderStatistics> RenderAt(std::int32_t level, bool counts) {
    v1::RenderIsosurfaceRequest request = testing::FrameRequest(8, 8);
    request.set_culling(v1::CULLING_NONE);
    request.mutable_level()->set_level(level);
    request.set_with_unresolved_count(counts);
    ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceResponse response, Render(request));
    return response.statistics();
  }

  std::atomic<int> asked_count_{0};
  std::atomic<bool> fails_{false};
};

TEST_F(UnresolvedFramesTest, FramesThatAskHaveThemCountedAndOthersTellWhatIsKnown) {
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::RenderStatistics statistics, RenderAt(1, false));
  EXPECT_FALSE(statistics.has_unresolved_block_count()) << "nobody waits for it";
  EXPECT_EQ(asked_count_, 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(statistics, RenderAt(1, true));
  EXPECT_EQ(statistics.unresolved_block_count(), 7 - 3);
  EXPECT_EQ(asked_count_, 2);
  for (const bool counts : {false, true}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(statistics, RenderAt(1, counts));
    EXPECT_EQ(statistics.unresolved_block_count(), 7 - 3);
  }
  EXPECT_EQ(asked_count_, 2) << "it is kept";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(statistics, RenderAt(0, true));
  EXPECT_FALSE(statistics.has_unresolved_block_count()) << "level 0 hides nothing";
}

TEST_F(UnresolvedFramesTest, APictureWithoutTheNumberIsStillRight) {
  const Running running = Start();
  fails_ = true;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::RenderStatistics statistics, RenderAt(1, true));
  EXPECT_FALSE(statistics.has_unresolved_block_count());
  fails_ = false;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(statistics, RenderAt(1, true));
  EXPECT_EQ(statistics.unresolved_block_count(), 7 - 3) << "a failure is not kept";
}

TEST_F(AgentQueriesTest, ACameraIsFittedToWhatTheClipRegionLeaves) {
  answer_.set_active_block_count(1);
  answer_.mutable_begin_cell();
  answer_.mutable_end_cell()->set_x(8);
  answer_.mutable_end_cell()->set_y(8);
  answer_.mutable_end_cell()->set_z(8);
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = RequestThatFits();
  v1::ClipRegion* const clip = request.mutable_clip();
  clip->add_half_spaces()->mutable_normal()->set_x(1);
  *clip->mutable_box()->mutable_min() = wire::ToProto(math::Vec3d{2, 2, 2});
  *clip->mutable_box()->mutable_max() = wire::ToProto(math::Vec3d{6, 6, 6});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera camera, RenderedCamera(request));
  const std::vector<AskedBox> asked = AskedFor(request.isovalue());
  ASSERT_FALSE(asked.empty());
  EXPECT_EQ(asked[0].request.clip().SerializeAsString(), clip->SerializeAsString());
  EXPECT_EQ(camera.SerializeAsString(),
            wire::ToProto(view::MakeDefaultCamera(BoxOf(2, 6))).SerializeAsString());
}

TEST_F(AgentQueriesTest, WithoutASurfaceTheCameraStays) {
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::Camera camera, RenderedCamera(RequestThatFits()));
  EXPECT_EQ(camera.SerializeAsString(),
            wire::ToProto(view::MakeDefaultCamera(BoxOf(0, 8))).SerializeAsString());
}

TEST_F(AgentQueriesTest, ABoxOutsideTheVolumeIsAnInternalError) {
  answer_.set_active_block_count(1);
  answer_.mutable_end_cell()->set_x(9);
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = RequestThatFits();
  const absl::Status status = RenderInTime(&request).status();
  const std::vector<AskedBox> asked = AskedFor(request.isovalue());
  ASSERT_EQ(asked.size(), 1U);
  EXPECT_THAT(status,
              StatusIs(absl::StatusCode::kInternal,
                       AllOf(HasSubstr(asked[0].agent->address()), HasSubstr("malformed"))));
}

}  // namespace
}  // namespace isoscope::server
