"""Operations: what can be asked of a running gateway, and the answers.

- operator     the running gateway, and what operations keep between requests
- operations   the table of all operations, from which every door is built; their parameters and answers
- units        units: found, described, which device or image answers, response times, rights, `forget`
- status       the status, what is wrong now, metrics
- values       values read, written, and known from what passes
- images       values that images, mirrors and virtual units hold
- trace        recorded traffic, and why requests failed
- past         the last events, and what lines and units did in the last days
- trends       how values of points went
- config       the config in use, those before, a text that might replace it; the reload
- fleet        what this gateway is and has, and the sites of a fleet
"""
