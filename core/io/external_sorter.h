// Sorts any number of records in bounded memory: external merge sort with a scratch file.
// Source: Knuth, The Art of Computer Programming 3, section 5.4.

#ifndef ISOSCOPE_CORE_IO_EXTERNAL_SORTER_H_
#define ISOSCOPE_CORE_IO_EXTERNAL_SORTER_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/scratch_file.h"
#include "core/io/scratch_records.h"

namespace isoscope::io {

// Add fills memory (M bytes) and writes it as a sorted run whenever it is full. Finish merges up to
// M / 64 KiB - 1 runs at a time into longer ones, until one last merge is left for the reader:
//
//   while (!sorter.is_at_end()) { Use(sorter.current()); RETURN_IF_ERROR(sorter.Advance()); }
// A merge keeps its runs in a heap by their next records. Up to M bytes nothing is written. Up to
// about M^2 / 64 KiB each record is written and read once: so 16 MiB sort 4 GiB. Records that are
// equal under Less come in any order. Thread-compatible. Returns the errors of the scratch file; a
// full disk is RESOURCE_EXHAUSTED.
template <typename Record, typename Less = std::less<Record>>
class ExternalSorter {
 public:
  // directory:    the scratch file is made here, without a name
  // memory_bytes: all buffers together (at least three records)
  ExternalSorter(std::string directory, std::int64_t memory_bytes, Less less = Less())
      : directory_(std::move(directory)), memory_bytes_(memory_bytes), less_(std::move(less)) {}

  // REQUIRES: Finish was not called.
  absl::Status Add(const Record& record) {
    if (run_.capacity() == 0) {
      run_.reserve(RecordsIn<Record>(memory_bytes_));
    }
    if (run_.size() == run_.capacity()) {
      ISOSCOPE_RETURN_IF_ERROR(Spill());
    }
    run_.push_back(record);
    ++count_;
    return absl::OkStatus();
  }

  // Ends adding. Then current() is the first record, if there is one.
  absl::Status Finish() {
    if (runs_.empty()) {
      std::sort(run_.begin(), run_.end(), less_);
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(Spill());
    run_ = std::vector<Record>();  // = {} would keep its memory
    const std::size_t fan_in =
        static_cast<std::size_t>(std::max<std::int64_t>(memory_bytes_ / kMergeBufferBytes - 1, 2));
    while (runs_.size() > fan_in) {
      ISOSCOPE_RETURN_IF_ERROR(MergeOnce(fan_in));
    }
    return merge_.Start(file_.get(), runs_, BufferBytes(runs_.size()), less_);
  }

  // Returns the number of added records.
  [[nodiscard]] std::int64_t count() const { return count_; }
  // REQUIRES for all below: Finish was called.
  [[nodiscard]] bool is_at_end() const {
    return runs_.empty() ? next_ == run_.size() : merge_.is_at_end();
  }
  // REQUIRES: !is_at_end(). Valid until the next Advance.
  [[nodiscard]] const Record& current() const {
    return runs_.empty() ? run_[next_] : merge_.current();
  }
  // REQUIRES: !is_at_end().
  absl::Status Advance() {
    if (runs_.empty()) {
      ++next_;
      return absl::OkStatus();
    }
    return merge_.Advance(less_);
  }

 private:
  // With smaller buffers a disk would seek more than read.
  static constexpr std::int64_t kMergeBufferBytes = 64 * base::kKiB;

  // Merges sorted runs: gives the least of their next records, again and again.
  class Merge {
   public:
    absl::Status Start(const ScratchFile* file, absl::Span<const ScratchRange> runs,
                       std::int64_t buffer_bytes, const Less& less) {
      for (const ScratchRange& run : runs) {
        auto input = std::make_unique<Input>(RecordReader<Record>(file, run, buffer_bytes));
        ISOSCOPE_ASSIGN_OR_RETURN(input->rest, input->reader.Next());
        if (!input->rest.empty()) {
          heap_.push_back(std::move(input));
        }
      }
      for (std::size_t i = heap_.size() / 2; i-- > 0;) {
        SiftDown(i, less);
      }
      return absl::OkStatus();
    }

    [[nodiscard]] bool is_at_end() const { return heap_.empty(); }
    [[nodiscard]] const Record& current() const { return heap_.front()->rest.front(); }

    absl::Status Advance(const Less& less) {
      Input& input = *heap_.front();
      input.rest.remove_prefix(1);
      if (input.rest.empty()) {
        ISOSCOPE_ASSIGN_OR_RETURN(input.rest, input.reader.Next());
        if (input.rest.empty()) {
          heap_.front().swap(heap_.back());
          heap_.pop_back();
        }
      }
      SiftDown(0, less);
      return absl::OkStatus();
    }

   private:
    struct Input {
      explicit Input(RecordReader<Record> run) : reader(std::move(run)) {}

      RecordReader<Record> reader;
      absl::Span<const Record> rest;  // of its buffer
    };

    void SiftDown(std::size_t i, const Less& less) {
      for (std::size_t child = 2 * i + 1; child < heap_.size(); child = 2 * i + 1) {
        if (child + 1 < heap_.size() &&
            less(heap_[child + 1]->rest.front(), heap_[child]->rest.front())) {
          ++child;
        }
        if (!less(heap_[child]->rest.front(), heap_[i]->rest.front())) {
          return;
        }
        std::swap(heap_[child], heap_[i]);
        i = child;
      }
    }

    std::vector<std::unique_ptr<Input>> heap_;
  };

  // Returns the buffer size of each of `reader_count` runs, and of the writer beside them.
  [[nodiscard]] std::int64_t BufferBytes(std::size_t reader_count) const {
    return std::min(memory_bytes_ / static_cast<std::int64_t>(reader_count + 1),
                    16 * kMergeBufferBytes);
  }

  // Writes the records in memory as a sorted run.
  absl::Status Spill() {
    if (file_ == nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(file_, ScratchFile::Create(directory_));
    }
    std::sort(run_.begin(), run_.end(), less_);
    const ScratchRange range{.offset = end_, .count = static_cast<std::int64_t>(run_.size())};
    const std::size_t bytes = run_.size() * sizeof(Record);
    ISOSCOPE_RETURN_IF_ERROR(
        file_->WriteAt(end_, reinterpret_cast<const char*>(run_.data()), bytes));
    end_ += static_cast<std::int64_t>(bytes);
    runs_.push_back(range);
    run_.clear();
    return absl::OkStatus();
  }

  // Merges `fan_in` runs at a time into a new file.
  absl::Status MergeOnce(std::size_t fan_in) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<ScratchFile> merged, ScratchFile::Create(directory_));
    const std::int64_t buffer_bytes = BufferBytes(fan_in);
    RecordWriter<Record> writer(merged.get(), 0, buffer_bytes);
    std::vector<ScratchRange> runs;
    for (std::size_t begin = 0; begin < runs_.size(); begin += fan_in) {
      ScratchRange range{.offset = writer.offset()};
      Merge merge;
      ISOSCOPE_RETURN_IF_ERROR(merge.Start(
          file_.get(), absl::MakeConstSpan(runs_).subspan(begin, fan_in), buffer_bytes, less_));
      for (; !merge.is_at_end(); ++range.count) {
        ISOSCOPE_RETURN_IF_ERROR(writer.Append(merge.current()));
        ISOSCOPE_RETURN_IF_ERROR(merge.Advance(less_));
      }
      runs.push_back(range);
    }
    ISOSCOPE_RETURN_IF_ERROR(writer.Flush());
    file_ = std::move(merged);
    runs_ = std::move(runs);
    return absl::OkStatus();
  }

  const std::string directory_;
  const std::int64_t memory_bytes_;
  const Less less_;
  std::int64_t count_ = 0;

  std::vector<Record> run_;  // in memory, not written yet; all records if nothing was written
  std::size_t next_ = 0;     // current, if nothing was written
  std::unique_ptr<ScratchFile> file_;
  std::int64_t end_ = 0;  // of the file
  std::vector<ScratchRange> runs_;
  Merge merge_;
};

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_EXTERNAL_SORTER_H_
