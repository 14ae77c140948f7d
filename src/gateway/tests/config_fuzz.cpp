// Any text is safe to give as a configuration. What is accepted has passed every check, and what is refused
// is told with a place, one line an error.
#include <cstdlib>

#include "gateway/config_makes.hpp"
#include "gateway/tests/toy_makes.hpp"

using namespace gantry;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    auto text = as_text({data, size});
    auto config = gateway::parse_config(text, "f", gateway::test::makes);
    if (!config) {
        auto errors = config.error().text();
        if (!errors.starts_with("f:") || errors.ends_with('\n')) std::abort();
        return 0;
    }
    for (auto& reader : config->readers)
        if (reader.name.empty() || reader.address.plugin == nullptr || reader.address.scheme == nullptr)
            std::abort();
    if (config->store.max_size == 0 || config->data_dir.empty()) std::abort();
    return 0;
}
