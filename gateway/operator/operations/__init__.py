"""What can be asked: the table of operations, their parameters and answers.

- table        all operations, by name: parameters, result, right; every door is built from it
- operation    one row of that table
- asked, answers    the types of parameters and of results
- parameters, results    read parameters from JSON or text, and results from JSON
- json_text, writing    write answers as JSON
"""
