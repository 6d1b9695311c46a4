"""One trial - plan, execute, watch, plan again or recover - and its trace."""
