// Values of an array that its attributes scale or call missing, by the CF conventions (xarray).

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_PACKING_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_PACKING_H_

#include <cstddef>
#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/zarr/zarr_metadata.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// Samples are slope * stored + intercept, and NaN where the stored value is missing.
struct ZarrPacking {
  double slope = 1;
  double intercept = 0;
  std::vector<double> missing{};  // stored values; none is NaN
  std::optional<double> valid_min{};
  std::optional<double> valid_max{};

  // Samples are the stored values.
  [[nodiscard]] bool is_plain() const {
    return slope == 1 && intercept == 0 && missing.empty() && !valid_min.has_value() &&
           !valid_max.has_value();
  }
  friend bool operator==(const ZarrPacking&, const ZarrPacking&) = default;
};

// Missing are the values of _FillValue and missing_value. So is the fill value of the array itself,
// where xarray writes _FillValue: of arrays with names of axes that are scaled, or are floats with
// another fill value than 0. INVALID_ARGUMENT: an attribute that is no number; a scale_factor of 0;
// limits that leave no value. The message is to follow a name and a colon.
absl::StatusOr<ZarrPacking> ZarrPackingOf(const ZarrArray& array);

// float32 if that holds every stored value, else float64.
volume::ScalarType UnpackedType(NumberType stored);
// `in` may be the tail of `out`. REQUIRES: the type is not kFloat16.
void UnpackZarr(const ZarrPacking& packing, NumberType stored, std::size_t count, const char* in,
                char* out);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_PACKING_H_
