#include "core/source/child/silent_libraries.h"

#include "itkObject.h"
#include "itkObjectFactory.h"
#include "itkOutputWindow.h"

namespace isoscope::source {
namespace {

class SilentWindow final : public itk::OutputWindow {
 public:
  using Self = SilentWindow;
  using Pointer = itk::SmartPointer<Self>;
  itkFactorylessNewMacro(Self);

  void DisplayText(const char* /*text*/) override {}
};

bool Silence() {
  itk::Object::GlobalWarningDisplayOff();
  itk::OutputWindow::SetInstance(SilentWindow::New());
  return true;
}

}  // namespace

void SilenceImageLibraries() { [[maybe_unused]] static const bool is_done = Silence(); }

}  // namespace isoscope::source
