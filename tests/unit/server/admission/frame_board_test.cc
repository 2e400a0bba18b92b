#include "server/admission/frame_board.h"

#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

FrameNote NoteOf(const char* request_id) {
  FrameNote note;
  note.request_id = request_id;
  note.client = "ipv4:1.2.3.4:5";
  note.width_px = 8;
  return note;
}

TEST(FrameBoardTest, NamesOfCallersAreBoundedWhileTheyAreKept) {
  FrameBoard board;
  FrameNote note = NoteOf("a");
  note.dataset = std::string(900'000, 'x');
  const FrameBoard::Entry entry = board.Add(note);
  EXPECT_EQ(board.Frames()[0].note.dataset.text(),
            std::string(256, 'x') + "... (cut, 900000 bytes)");
}

TEST(FrameBoardTest, FramesStandInTheOrderOfArrivalWithTheirSteps) {
  FrameBoard board;
  const FrameBoard::Entry first = board.Add(NoteOf("a"));
  const FrameBoard::Entry second = board.Add(NoteOf("b"));
  second.phase()->store(FramePhase::kOccluderRendering);
  const std::vector<FrameBoard::Frame> frames = board.Frames();
  ASSERT_EQ(frames.size(), 2u);
  EXPECT_EQ(frames[0].note.request_id, "a");
  EXPECT_EQ(frames[0].note.client, "ipv4:1.2.3.4:5");
  EXPECT_EQ(frames[0].phase, FramePhase::kQueued);
  EXPECT_EQ(frames[1].note.width_px, 8);
  EXPECT_EQ(frames[1].phase, FramePhase::kOccluderRendering);
}

TEST(FrameBoardTest, AFrameLeavesOnceWithItsEntryAlsoAfterAMove) {
  FrameBoard board;
  std::optional<FrameBoard::Entry> kept;
  {
    FrameBoard::Entry entry = board.Add(NoteOf("a"));
    kept.emplace(std::move(entry));
  }
  EXPECT_EQ(board.Frames().size(), 1u);
  kept.reset();
  EXPECT_TRUE(board.Frames().empty());
}

TEST(FrameBoardTest, ThreadsComeAndGoWhileOthersLook) {
  FrameBoard board;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      for (int k = 0; k < 500; ++k) {
        const FrameBoard::Entry entry = board.Add(NoteOf("x"));
        entry.phase()->store(FramePhase::kFinishing);
        EXPECT_GE(board.Frames().size(), 1u);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_TRUE(board.Frames().empty());
}

}  // namespace
}  // namespace isoscope::server
