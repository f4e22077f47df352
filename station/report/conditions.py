"""Names of the conditions of an assessment, as the report and its charts show them."""

CONDITIONS = {
    "slack": "slack cord",
    "rigid": "rigid cuffs",
    "shift": "migration",
    "visco_elastic": "compliance",
    "both": "migration and compliance",
}
LIMIT = "rigid cuffs (theoretical limit)"
