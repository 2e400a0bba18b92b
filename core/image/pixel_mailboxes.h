// Drawn pixels on their way from agents to the coordinator of the same process, neither encoded nor
// copied.

#ifndef ISOSCOPE_CORE_IMAGE_PIXEL_MAILBOXES_H_
#define ISOSCOPE_CORE_IMAGE_PIXEL_MAILBOXES_H_

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"

namespace isoscope::image {

// The pixels of one step of a frame.
struct DrawnPixels {
  FrameImage image;
  LayerStack layers;                   // empty without translucent surfaces
  std::shared_ptr<const void> memory;  // the reservation of their bytes; dropped with them
};

// Thread-safe. Made by Make, shared by the coordinator and the agents of a process.
class PixelMailboxes : public std::enable_shared_from_this<PixelMailboxes> {
 public:
  static std::shared_ptr<PixelMailboxes> Make();

  // The coordinator's end of one mailbox. Its destructor drops what was not taken. Thread-safe.
  class Mailbox {
   public:
    Mailbox(std::shared_ptr<PixelMailboxes> mailboxes, std::int64_t number)
        : mailboxes_(std::move(mailboxes)), number_(number) {}
    ~Mailbox() { mailboxes_->Close(number_); }
    Mailbox(const Mailbox&) = delete;
    Mailbox& operator=(const Mailbox&) = delete;

    // Names the mailbox to the agent. > 0.
    [[nodiscard]] std::int64_t number() const { return number_; }
    // Returns what was put in first; nothing if the mailbox is empty.
    std::optional<DrawnPixels> Take() { return mailboxes_->Take(number_); }

   private:
    const std::shared_ptr<PixelMailboxes> mailboxes_;
    const std::int64_t number_;
  };

  // Opens a mailbox for one agent's part in one frame.
  std::unique_ptr<Mailbox> Open();
  // Returns false, and drops the pixels, if no such mailbox is open.
  bool Put(std::int64_t number, DrawnPixels pixels);

 private:
  PixelMailboxes() = default;
  std::optional<DrawnPixels> Take(std::int64_t number);
  void Close(std::int64_t number);

  base::Mutex mutex_;
  std::int64_t last_number_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<std::int64_t, std::deque<DrawnPixels>> open_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_PIXEL_MAILBOXES_H_
