// Guesses the step that a play shows next, from the steps of the frames before.
//
// A play goes forwards or backwards, step by step or in strides, and from the last step on to the
// first one. Clients that play the same may take turns. The guess is one step, so that a play that
// stops or turns wastes no more than that.
//
//   frames                     guess
//   3, 4                       5: neighbours, one after the other
//   3, 2                       1
//   0, 5, 10                   15: the same distance twice
//   48, 49 (of 50)             0
//   3, 30, 4, 31, 5            6: two clients that take turns
//   3, 30, 17                  none

#ifndef ISOSCOPE_PARTITION_AGENT_PLAY_PLAY_DETECTOR_H_
#define ISOSCOPE_PARTITION_AGENT_PLAY_PLAY_DETECTOR_H_

#include <cstddef>
#include <list>
#include <optional>
#include <string>
#include <vector>

namespace isoscope::agent {

// Thread-compatible.
class PlayDetector {
 public:
  struct Guess {
    std::optional<int> next;  // a position; not set: no play
    // The frame continues the one before it, or nothing. Otherwise clients take turns.
    bool follows_last = true;
  };

  // Notes a frame, and returns the guess about the one that follows. The same position again has
  // the same guess: a moved camera stops no play.
  //
  // look:     names all that frames of one play have in common
  // position: among the steps that are served, in [0, count)
  Guess Note(const std::string& look, int position, int count);

 private:
  struct Look {
    std::string name;
    int count = 0;
    std::vector<int> recent;  // positions, each once, the last one first
    Guess guess;
  };
  static constexpr std::size_t kMaxLooks = 8;
  static constexpr std::size_t kMaxRecent = 9;

  std::list<Look> looks_;  // the last used one first
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_PLAY_PLAY_DETECTOR_H_
