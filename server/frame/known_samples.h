// The samples that a volume has, as far as its histogram tells, and the sentences about surfaces
// that follow from them. No gRPC types.

#ifndef ISOSCOPE_SERVER_FRAME_KNOWN_SAMPLES_H_
#define ISOSCOPE_SERVER_FRAME_KNOWN_SAMPLES_H_

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/volume/inside_rule.h"
#include "core/volume/label.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_type.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::server {

// Immutable.
class KnownSamples {
 public:
  using Reason = isoscope::v1::SurfaceNote::Reason;
  // A reason, and a sentence without its full stop: "isovalue 300 has no surface: ...".
  using Note = std::pair<Reason, std::string>;

  // histogram: of the whole volume, with groups of one bin each
  // labels:    of the dataset, for names
  // when:      " at step 3"; empty if the dataset has one step
  KnownSamples(volume::ScalarType type, volume::HistogramPart histogram,
               std::vector<volume::Label> labels, std::string when);

  // Returns why no volume with such samples can have the surface, or why a part of its labels shows
  // nothing; none if the samples do not tell.
  [[nodiscard]] std::optional<Note> NoteOf(const volume::InsideRule& rule) const;

  // Returns the note of a surface that no cell has, though its samples are there.
  [[nodiscard]] Note NoCellNoteOf(const volume::InsideRule& rule, int level = 0) const;

  // Returns the surface's name for people: "isovalue 5", "label 3, left lung".
  [[nodiscard]] std::string NameOf(const volume::InsideRule& rule) const;

 private:
  // False if no sample has the value; true also if that is not known.
  [[nodiscard]] bool MayHave(double value) const;
  // False if all samples are infinite, with one sign.
  [[nodiscard]] bool MayBeFinite() const;
  // "the samples are 0 to 3, 7", or the range of values.
  [[nodiscard]] std::string TextOfSamples() const;
  [[nodiscard]] std::string TextOfRange() const;
  [[nodiscard]] std::string NamesOf(const std::vector<double>& labels) const;

  const volume::ScalarType type_;
  const volume::HistogramPart histogram_;
  const std::vector<volume::Label> labels_;
  const std::string when_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_KNOWN_SAMPLES_H_
