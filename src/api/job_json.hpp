#pragma once
#include <boost/json/fwd.hpp>

#include "base/error.hpp"
#include "gateway/job_record.hpp"
#include "reader/plugin.hpp"

// Jobs as JSON, the same for programs and for the command line.
namespace gantry::api {

// {"op":"tag.read","tag":"3074257B…","bank":"user","offset":0,"length":4,…}: a job for a reader of this make.
// Passwords are never part of an error's text.
Result<Job> job_from_json(const boost::json::object& request, const Plugin& make);

// {"id":7,"reader":"dock-1","op":"tag.read","status":"done","values":{"data":"0011"},…}. The values of exec
// are [name, value] pairs in the order of the answer, where a name may come twice; of all others an object.
enum class Values : std::uint8_t { shown, hidden };
boost::json::object job_to_json(const gateway::JobStatus& job, Values values = Values::shown);

}  // namespace gantry::api
