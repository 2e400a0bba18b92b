// One fragment in each lane:
//
// 1. Decode the normal, as image::DecodeNormal does but in floats.
// 2. v is the direction against the ray through the pixel. c = |n . v|; n is turned to v.
// 3. Sum up D and S over the lights. The unit vector halfway between l and v is not needed:
//    |l + v|^2 = 2 + 2 l . v, so n . h = (n . l + c) / sqrt(2 + 2 l . v).
// 4. colour = base * (ambient + diffuse * D) + specular * S.

#include "core/picture/light_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/picture/light_kernel.cc"
#include "hwy/foreach_target.h"
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::picture {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;

struct Vec3 {
  VF x;
  VF y;
  VF z;
};
HWY_INLINE VF Dot(const Vec3& a, const Vec3& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE Vec3 Scale(const Vec3& a, VF s) {
  return {hn::Mul(a.x, s), hn::Mul(a.y, s), hn::Mul(a.z, s)};
}
HWY_INLINE Vec3 Set(const std::array<float, 3>& v) {
  const DF df;
  return {hn::Set(df, v[0]), hn::Set(df, v[1]), hn::Set(df, v[2])};
}

// Four colours' bytes as the lanes of a vector: red in the lowest byte.
HWY_INLINE VU LoadColors(const LightBatch::Lane<image::Rgba8>& lane, std::size_t i) {
  return hn::LoadU(DU(), reinterpret_cast<const std::uint32_t*>(lane.data()) + i);
}
template <int kShift>
HWY_INLINE VF ChannelOf(VU colors) {
  const VU byte = hn::And(hn::ShiftRight<kShift>(colors), hn::Set(DU(), 0xff));
  return hn::Mul(hn::ConvertTo(DF(), hn::BitCast(DI(), byte)), hn::Set(DF(), 1.0F / 255.0F));
}

// A coordinate of the octahedron, of two bytes with the higher one first.
HWY_INLINE VF CoordinateOf(VU high_byte, VU low_byte) {
  const DI di;
  const VU code = hn::Or(hn::ShiftLeft<24>(high_byte), hn::ShiftLeft<16>(low_byte));
  const VF value = hn::ConvertTo(DF(), hn::ShiftRight<16>(hn::BitCast(di, code)));
  return hn::Max(hn::Mul(value, hn::Set(DF(), 1.0F / 32767.0F)), hn::Set(DF(), -1.0F));
}

HWY_INLINE Vec3 DecodeNormals(VU codes) {
  const DF df;
  const VU low = hn::Set(DU(), 0xff);
  const VF one = hn::Set(df, 1.0F);
  VF x = CoordinateOf(hn::And(codes, low), hn::And(hn::ShiftRight<8>(codes), low));
  VF y = CoordinateOf(hn::And(hn::ShiftRight<16>(codes), low), hn::ShiftRight<24>(codes));
  const VF z = hn::Sub(hn::Sub(one, hn::Abs(x)), hn::Abs(y));
  // The lower half is folded out.
  const auto is_lower = hn::Lt(z, hn::Zero(df));
  const auto signed_one = [&](VF v) HWY_ATTR {
    return hn::IfThenElse(hn::Lt(v, hn::Zero(df)), hn::Neg(one), one);
  };
  const VF folded_x = hn::Mul(hn::Sub(one, hn::Abs(y)), signed_one(x));
  const VF folded_y = hn::Mul(hn::Sub(one, hn::Abs(x)), signed_one(y));
  x = hn::IfThenElse(is_lower, folded_x, x);
  y = hn::IfThenElse(is_lower, folded_y, y);
  const Vec3 v{x, y, z};
  return Scale(v, hn::Div(one, hn::Sqrt(Dot(v, v))));
}

// The table of s^shininess of each lane's surface.
struct Powers {
  const float* values;
  VI first;  // of the surface
  VF first_power;
  VF scale;
};
HWY_INLINE VF PowerOf(const Powers& powers, VF s) {
  const DF df;
  const DI di;
  const VF step =
      hn::Min(hn::Max(hn::Mul(hn::Sub(s, powers.first_power), powers.scale), hn::Zero(df)),
              hn::Set(df, static_cast<float>(kPowerSteps)));
  const VI whole =
      hn::Min(hn::ConvertTo(di, step), hn::Set(di, static_cast<std::int32_t>(kPowerSteps) - 1));
  const VF share = hn::Sub(step, hn::ConvertTo(df, whole));
  const VI at = hn::Add(powers.first, whole);
  const VF below = hn::GatherIndex(df, powers.values, at);
  const VF above = hn::GatherIndex(df, powers.values + 1, at);
  return hn::Add(below, hn::Mul(hn::Sub(above, below), share));
}

HWY_INLINE VU ByteOf(VF value) {
  const DF df;
  const VF clamped = hn::Min(hn::Max(value, hn::Zero(df)), hn::Set(df, 1.0F));
  const VF scaled = hn::Add(hn::Mul(clamped, hn::Set(df, 255.0F)), hn::Set(df, 0.5F));
  return hn::BitCast(DU(), hn::ConvertTo(DI(), scaled));
}

// The light that falls on a point: D and S for each channel.
struct Light {
  Vec3 diffuse;
  Vec3 specular;
};

HWY_INLINE Light SumUp(const std::vector<LightTerm>& lights, const Vec3& normal, const Vec3& to_eye,
                       VF facing, const Powers& powers) {
  const DF df;
  const VF zero = hn::Zero(df);
  const VF one = hn::Set(df, 1.0F);
  if (lights.empty()) {
    const VF highlight = PowerOf(powers, facing);
    return {{facing, facing, facing}, {highlight, highlight, highlight}};
  }
  Light sum{{zero, zero, zero}, {zero, zero, zero}};
  for (const LightTerm& light : lights) {
    const Vec3 direction = Set(light.direction);
    const VF along = Dot(normal, direction);
    const auto is_lit = hn::Gt(along, zero);
    const VF d = hn::Min(hn::IfThenElseZero(is_lit, along), one);
    // Where l = -v nothing is lit; the least number keeps the quotient finite.
    const VF two = hn::Set(df, 2.0F);
    const VF half_squared =
        hn::Max(hn::Add(two, hn::Mul(two, Dot(direction, to_eye))), hn::Set(df, 1e-6F));
    const VF s = hn::Min(hn::Div(hn::Add(along, facing), hn::Sqrt(half_squared)), one);
    const VF highlight = hn::IfThenElseZero(is_lit, PowerOf(powers, s));
    const Vec3 strength = Set(light.strength);
    sum.diffuse = {hn::Add(sum.diffuse.x, hn::Mul(strength.x, d)),
                   hn::Add(sum.diffuse.y, hn::Mul(strength.y, d)),
                   hn::Add(sum.diffuse.z, hn::Mul(strength.z, d))};
    sum.specular = {hn::Add(sum.specular.x, hn::Mul(strength.x, highlight)),
                    hn::Add(sum.specular.y, hn::Mul(strength.y, highlight)),
                    hn::Add(sum.specular.z, hn::Mul(strength.z, highlight))};
  }
  return sum;
}

// Returns the base colour: the lane's, or the colour of the normal.
HWY_INLINE Vec3 BaseOf(VU base, const Vec3& normal, VF is_by_normal) {
  const DF df;
  const VF half = hn::Set(df, 0.5F);
  const auto by_normal = hn::Gt(is_by_normal, half);
  const auto channel = [&](VF normal_part, VF base_part) HWY_ATTR {
    return hn::IfThenElse(by_normal, hn::Add(hn::Mul(normal_part, half), half), base_part);
  };
  return {channel(normal.x, ChannelOf<0>(base)), channel(normal.y, ChannelOf<8>(base)),
          channel(normal.z, ChannelOf<16>(base))};
}

HWY_INLINE Vec3 DirectionsToEye(const view::LinearVec3f& rays, VF x, VF y) {
  const DF df;
  const auto axis = [&](std::size_t k) HWY_ATTR {
    return hn::Add(hn::Add(hn::Set(df, rays.at[k]), hn::Mul(hn::Set(df, rays.per_x[k]), x)),
                   hn::Mul(hn::Set(df, rays.per_y[k]), y));
  };
  const Vec3 ray{axis(0), axis(1), axis(2)};
  return Scale(ray, hn::Div(hn::Set(df, -1.0F), hn::Sqrt(Dot(ray, ray))));
}

void ComputeLight(const std::vector<LightTerm>& lights, const view::LinearVec3f& rays,
                  const MaterialTerms& materials, LightBatch* batch) {
  const DF df;
  const DI di;
  const DU du;
  const VF zero = hn::Zero(df);
  const VF one = hn::Set(df, 1.0F);
  const VU no_normal = hn::Set(du, 0x00800080U);  // image::kNoNormal
  for (std::size_t i = 0; i < batch->count; i += hn::Lanes(df)) {
    const VI surface = hn::LoadU(di, batch->surface.data() + i);
    const auto surface_term = [&](const MaterialTerms::BySurface<float>& values)
                                  HWY_ATTR { return hn::GatherIndex(df, values.data(), surface); };
    const VU codes = LoadColors(batch->normal, i);
    const auto has_normal = hn::RebindMask(df, hn::Ne(codes, no_normal));
    const Vec3 decoded = DecodeNormals(codes);
    const Vec3 given{hn::IfThenElseZero(has_normal, decoded.x),
                     hn::IfThenElseZero(has_normal, decoded.y),
                     hn::IfThenElseZero(has_normal, decoded.z)};
    const Vec3 to_eye = DirectionsToEye(rays, hn::LoadU(df, batch->x.data() + i),
                                        hn::LoadU(df, batch->y.data() + i));
    const VF cosine = Dot(given, to_eye);
    const VF side = hn::IfThenElse(hn::Lt(cosine, zero), hn::Neg(one), one);
    const Vec3 normal{hn::IfThenElse(has_normal, hn::Mul(given.x, side), to_eye.x),
                      hn::IfThenElse(has_normal, hn::Mul(given.y, side), to_eye.y),
                      hn::IfThenElse(has_normal, hn::Mul(given.z, side), to_eye.z)};
    const VF facing = hn::IfThenElse(has_normal, hn::Min(hn::Abs(cosine), one), one);

    const Powers powers{materials.powers.data(),
                        hn::Mul(surface, hn::Set(di, static_cast<std::int32_t>(kPowerSteps) + 1)),
                        surface_term(materials.first_power), surface_term(materials.power_scale)};
    const Light light = SumUp(lights, normal, to_eye, facing, powers);
    const VU base_colors = LoadColors(batch->base, i);
    const Vec3 base = BaseOf(base_colors, given, surface_term(materials.is_by_normal));
    const VF ambient = surface_term(materials.ambient);
    const VF diffuse = surface_term(materials.diffuse);
    const VF specular = surface_term(materials.specular);
    const auto channel = [&](VF base_part, VF d, VF s) HWY_ATTR {
      return ByteOf(
          hn::Add(hn::Mul(base_part, hn::Add(ambient, hn::Mul(diffuse, d))), hn::Mul(specular, s)));
    };
    const VU red = channel(base.x, light.diffuse.x, light.specular.x);
    const VU green = channel(base.y, light.diffuse.y, light.specular.y);
    const VU blue = channel(base.z, light.diffuse.z, light.specular.z);
    const VU alpha = hn::And(base_colors, hn::Set(du, 0xff000000U));
    hn::StoreU(hn::Or(hn::Or(red, hn::ShiftLeft<8>(green)), hn::Or(hn::ShiftLeft<16>(blue), alpha)),
               du, reinterpret_cast<std::uint32_t*>(batch->color.data()) + i);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::picture
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::picture {
namespace {

HWY_EXPORT(ComputeLight);

}  // namespace

void ComputeLight(const std::vector<LightTerm>& lights, const view::LinearVec3f& rays,
                  const MaterialTerms& materials, LightBatch* batch) {
  HWY_DYNAMIC_DISPATCH(ComputeLight)(lights, rays, materials, batch);
}

}  // namespace isoscope::picture
#endif  // HWY_ONCE
