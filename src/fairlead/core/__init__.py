"""Records, roles, named random streams, budgets, artifacts and errors: what every other package stands on."""
