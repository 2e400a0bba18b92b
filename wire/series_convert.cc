#include "wire/series_convert.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;

v1::ValueRange SpanToProto(const volume::ScalarSpan& span) {
  v1::ValueRange range;
  range.set_min(span.min);
  range.set_max(span.max);
  return range;
}

void Cover(const volume::ScalarSpan& more, volume::ScalarSpan* span) {
  span->min = std::min(span->min, more.min);
  span->max = std::max(span->max, more.max);
}

// Sets the ranges of a component to those of all its volumes.
void SetRanges(const std::vector<const store::ScalarVolume*>& volumes,
               v1::FieldComponent* component) {
  volume::ScalarSpan all;
  volume::ScalarSpan finite;
  bool is_finite_known = true;
  for (const store::ScalarVolume* volume : volumes) {
    const volume::ScalarSpan& range = volume->value_range;
    Cover(range, &all);
    Cover(volume->finite_range.value_or(range), &finite);
    is_finite_known &=
        volume->finite_range.has_value() || volume::IsFinite(range) || !(range.min <= range.max);
  }
  if (all.min <= all.max) {
    *component->mutable_value_range() = SpanToProto(all);
    if (!volume::IsFinite(all) && is_finite_known && finite.min <= finite.max) {
      *component->mutable_finite_range() = SpanToProto(finite);
    }
  }
}

// A bound holds for all steps only if every volume has one.
void CoverGradients(const std::vector<const store::ScalarVolume*>& volumes,
                    v1::FieldComponent* component) {
  double bound = 0;
  for (const store::ScalarVolume* volume : volumes) {
    if (!volume->max_gradient_magnitude.has_value()) {
      return;
    }
    bound = std::max(bound, *volume->max_gradient_magnitude);
  }
  component->set_max_gradient_magnitude(bound);
}

}  // namespace

v1::Dataset ToProto(const store::SeriesManifest& manifest) {
  store::Manifest grid;  // of what a dataset without fields has, too
  grid.name = manifest.name;
  grid.dataset_id = manifest.dataset_id;
  grid.source = manifest.source;
  grid.geometry = manifest.geometry;
  grid.block_cells = manifest.block_cells;
  grid.patient_frame = manifest.patient_frame;
  grid.labels = manifest.labels;
  grid.shards.resize(static_cast<std::size_t>(manifest.shard_count));
  v1::Dataset proto = ToProto(grid);
  proto.clear_value_range();
  proto.set_time_unit(manifest.time_unit);
  proto.set_length_unit(manifest.length_unit);
  for (std::size_t step = 0; step < manifest.times.size(); ++step) {
    v1::TimeStep* const time = proto.add_time_steps();
    time->set_value(manifest.times[step]);
    time->set_number(static_cast<std::int32_t>(step));
  }
  for (std::size_t i = 0; i < manifest.fields.size(); ++i) {
    const store::Field& field = manifest.fields[i];
    v1::Field* const out = proto.add_fields();
    out->set_name(field.name);
    out->set_long_name(field.long_name);
    out->set_unit(field.unit);
    for (std::size_t j = 0; j < field.components.size(); ++j) {
      v1::FieldComponent* const component = out->add_components();
      component->set_name(field.components[j].name);
      component->set_sample_type(ToProto(field.components[j].scalar_type));
      std::vector<const store::ScalarVolume*> volumes;
      for (const store::ScalarVolume& volume : manifest.volumes) {
        if (volume.key.field == static_cast<int>(i) &&
            volume.key.component == static_cast<int>(j)) {
          volumes.push_back(&volume);
        }
      }
      SetRanges(volumes, component);
      CoverGradients(volumes, component);
    }
  }
  const v1::Field& first = proto.fields(0);
  const v1::FieldComponent& standard = first.components(first.components_size() - 1);
  proto.set_sample_type(standard.sample_type());
  if (standard.has_value_range()) {
    *proto.mutable_value_range() = standard.value_range();
  }
  if (standard.has_finite_range()) {
    *proto.mutable_finite_range() = standard.finite_range();
  }
  if (standard.has_max_gradient_magnitude()) {
    proto.set_max_gradient_magnitude(standard.max_gradient_magnitude());
  }
  return proto;
}

isoscope::internal::v1::VolumeDescription ToProto(const store::ScalarVolume& volume) {
  isoscope::internal::v1::VolumeDescription proto;
  proto.set_field_index(volume.key.field);
  proto.set_component_index(volume.key.component);
  proto.set_step_number(volume.key.step);
  proto.set_dataset_id(volume.dataset_id);
  proto.set_manifest_crc32c(volume.manifest_crc32c);
  if (volume.value_range.min <= volume.value_range.max) {
    proto.mutable_value_range()->set_min(volume.value_range.min);
    proto.mutable_value_range()->set_max(volume.value_range.max);
  }
  if (volume.finite_range.has_value() && volume::IsFinite(*volume.finite_range)) {
    proto.mutable_finite_range()->set_min(volume.finite_range->min);
    proto.mutable_finite_range()->set_max(volume.finite_range->max);
  }
  if (volume.max_gradient_magnitude.has_value()) {
    proto.set_max_gradient_magnitude(*volume.max_gradient_magnitude);
  }
  return proto;
}

store::ScalarVolumeKey KeyOf(const isoscope::internal::v1::VolumeDescription& volume) {
  return {.field = volume.field_index(),
          .component = volume.component_index(),
          .step = volume.step_number()};
}

}  // namespace isoscope::wire
