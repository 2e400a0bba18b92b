// Members that the manifests of both format versions share (docs/format/dataset.md). Internal to
// core/store.

#ifndef ISOSCOPE_CORE_STORE_MANIFEST_MEMBERS_H_
#define ISOSCOPE_CORE_STORE_MANIFEST_MEMBERS_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/store/json_fields.h"
#include "core/volume/label.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_span.h"

namespace isoscope::store {

Json JsonFromIndex(const math::Index3& index);
Json JsonFromVector(const math::Vec3d& vector);
Json JsonFromDirection(const math::Mat3d& direction);
Json JsonFromRange(const volume::ScalarSpan& range);
// Adds the member "labels"; none if there are no labels.
void AddLabels(const std::vector<volume::Label>& labels, Json* json);

// Read a member as JsonFields does.
void ReadIndex(const char* name, std::int64_t min, std::int64_t max, JsonFields* fields,
               math::Index3* index);
void ReadVector(const char* name, JsonFields* fields, math::Vec3d* vector);
// Leaves the frame unset if there is no such member.
void ReadPatientFrame(absl::string_view where, JsonFields* fields,
                      std::optional<volume::PatientFrame>* frame);
// Leaves the range unset if there is no such member.
void ReadFiniteRange(absl::string_view where, JsonFields* fields,
                     std::optional<volume::ScalarSpan>* range);
// Leaves the labels empty if there is no such member.
void ReadLabels(absl::string_view where, JsonFields* fields, std::vector<volume::Label>* labels);

// Returns the format version of a manifest. Version 3 must be of this kind, and require nothing that
// this program does not know; version 1 is of kVolumeKind, 2 of kSeriesKind. FAILED_PRECONDITION.
absl::StatusOr<int> ReadVersion(const Json& json, absl::string_view where, absl::string_view kind);

// Read an object. DATA_LOSS names `where`.
absl::Status ReadDirection(const Json& json, absl::string_view where, math::Mat3d* direction);
absl::Status ReadRange(const Json& json, absl::string_view where, volume::ScalarSpan* range);

// DATA_LOSS if the range of the finite samples contradicts that of all samples.
absl::Status CheckFiniteRange(const volume::ScalarSpan& value_range,
                              const std::optional<volume::ScalarSpan>& finite_range);

// True for the digests of a manifest: 32 lower-case hex digits.
bool IsDigest(const std::string& id);
// DATA_LOSS with the message of `status` behind `where`. REQUIRES: !status.ok().
absl::Status WithContext(absl::string_view where, const absl::Status& status);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_MANIFEST_MEMBERS_H_
